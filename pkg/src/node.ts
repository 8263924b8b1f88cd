/** Node.js has no fetch for `file:` URLs, where a package's own files are. Nothing here is touched in a browser. */
import { GravisightError } from "./error.js";

interface Node {
  version: string;
  versions: { node?: string };
  cwd(): string;
  getBuiltinModule(name: "node:fs"): {
    existsSync(path: URL): boolean;
    promises: { readFile(path: URL): Promise<Uint8Array<ArrayBuffer>> };
  };
}

const node = (globalThis as { process?: Partial<Node> }).process;

/** Whether `url` is a file that this program may read. @throws {@link GravisightError} `node-version`. */
export function isFile(url: string): boolean {
  if (!url.startsWith("file:")) return false;
  if (node?.versions?.node && !node.getBuiltinModule) {
    throw new GravisightError("node-version", `This is Node.js ${node.version}; gravisight needs 20.19, or 22.12 or later.`);
  }
  return node?.getBuiltinModule !== undefined;
}

export function fileExists(url: URL): boolean {
  return node?.getBuiltinModule?.("node:fs").existsSync(url) ?? false;
}

export async function readFile(url: URL): Promise<Uint8Array<ArrayBuffer>> {
  const read = await (node as Node).getBuiltinModule("node:fs").promises.readFile(url);
  return new Uint8Array(read);
}

/** The folder that relative paths start from, as a URL; undefined in a browser. */
export function workingFolder(): string | undefined {
  return node?.cwd && node.getBuiltinModule ? `file://${encodeURI(node.cwd().replaceAll("\\", "/"))}/` : undefined;
}
