/** Node.js has no fetch for `file:` URLs, where a package's own files are. Nothing here is touched in a browser. */
import { GravisightError, messageOf } from "./error.js";
import type { FromWorker, ToWorker } from "./protocol.js";
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
  on(event: "message" | "messageerror" | "error", listener: (thing: unknown) => void): void;
  once(event: "message" | "error", listener: (thing: unknown) => void): void;
  postMessage(message: ThreadStart | ToWorker, transfer?: Transferable[]): void;
  terminate(): void;
  ref(): void;
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

/** A script of this package. A bundler that found its name in `new URL` would copy the file into a page, which cannot use it. */
function script(name: "thread" | "worker"): URL {
  const file = `${name}.js`;
  return new URL(file, import.meta.url);
}

/** A thread of Node.js, which keeps no program alive; undefined in a browser. */
export function nodeThread(): Thread | undefined {
  if (!isNode()) return undefined;
  const { Worker: NodeThread } = (node as Node).getBuiltinModule("node:worker_threads");
  // Without the program's own switches: `--input-type` would be refused.
  const thread = new NodeThread(script("thread"), { execArgv: [] });
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

/** A Worker of Node.js that serves one object, as a browser's would. It keeps a program alive only while it is at work. */
export function nodeWorker(): Worker {
  const { Worker: NodeThread } = (node as Node).getBuiltinModule("node:worker_threads");
  const worker = new NodeThread(script("worker"), { execArgv: [] });
  worker.unref();
  const events = new EventTarget();
  worker.on("message", (data) => {
    const { type } = data as FromWorker;
    if (type === "done" || type === "failed") worker.unref();
    events.dispatchEvent(new MessageEvent("message", { data }));
  });
  worker.on("messageerror", () => events.dispatchEvent(new Event("messageerror")));
  worker.on("error", (thrown) => events.dispatchEvent(Object.assign(new Event("error"), { message: messageOf(thrown) })));
  const postMessage = (message: ToWorker, transfer: Transferable[]) => {
    worker.postMessage(message, transfer);
    if ("id" in message) worker.ref();
  };
  return Object.assign(events, { postMessage, terminate: () => worker.terminate() }) as unknown as Worker;
}
