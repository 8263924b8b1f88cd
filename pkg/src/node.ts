/** Node.js has no fetch for `file:` URLs, where a package's own files are. Nothing here is touched in a browser. */
import { GravisightError } from "./error.js";
import type { ThreadStart } from "./thread.js";
import type { Thread } from "./threads.js";

interface Node {
  version: string;
  versions: { node?: string };
  cwd(): string;
  getBuiltinModule(name: "node:fs"): {
    existsSync(path: URL): boolean;
    promises: { readFile(path: URL): Promise<Uint8Array<ArrayBuffer>> };
  };
  getBuiltinModule(name: "node:worker_threads"): { Worker: new (script: URL, options: { execArgv: string[] }) => NodeWorker; parentPort: unknown };
}

interface NodeWorker {
  once(event: "message" | "error", listener: (thing: unknown) => void): void;
  postMessage(message: ThreadStart): void;
  terminate(): void;
  unref(): void;
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

export function isNode(): boolean {
  return node?.versions?.node !== undefined && node.getBuiltinModule !== undefined;
}

/** The port of a Worker of Node.js; undefined elsewhere. */
export function ownPort<T>(): T | undefined {
  return isNode() ? ((node as Node).getBuiltinModule("node:worker_threads").parentPort as T) : undefined;
}

/** A thread of Node.js, which keeps no program alive; undefined in a browser. */
export function nodeThread(): Thread | undefined {
  if (!isNode()) return undefined;
  const { Worker: NodeThread } = (node as Node).getBuiltinModule("node:worker_threads");
  // Without the program's own switches: `--input-type` would be refused.
  const thread = new NodeThread(new URL("./thread.js", import.meta.url), { execArgv: [] });
  return {
    ready: (start) =>
      new Promise((resolve, reject) => {
        thread.once("message", () => {
          thread.unref();
          resolve();
        });
        thread.once("error", reject);
        thread.postMessage(start);
      }),
    end: () => thread.terminate(),
  };
}
