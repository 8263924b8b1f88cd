/** The threads of a build that has them: Workers that share its memory. */
import { GravisightError } from "./error.js";
import { isNode, nodeThread } from "./node.js";
import type { ThreadedModule, ThreadStart } from "./thread.js";
import type { CoreOptions } from "./types.js";

/** Threads that `auto` takes at most: more share too little work. */
const MOST = 8;

/** @throws {@link GravisightError} `threads`. */
export function checkedThreads(threads: CoreOptions["threads"]): number | "auto" {
  if (threads === undefined) return 1;
  if (threads === "auto" || (Number.isInteger(threads) && threads >= 1)) return threads;
  throw new GravisightError("threads", `threads is ${JSON.stringify(threads)}; it must be "auto" or a whole number of 1 or more.`);
}

/** How many threads an engine can have in a Worker of this page, or in Node.js: one where memory cannot be shared. */
export function threadsInWorker(wanted: number | "auto"): number {
  const isolated = (globalThis as { crossOriginIsolated?: boolean }).crossOriginIsolated !== false && typeof SharedArrayBuffer === "function";
  if (!isolated) return 1;
  return wanted === "auto" ? Math.min(globalThis.navigator?.hardwareConcurrency ?? 1, MOST) : wanted;
}

/** The same for an engine right here: one on a page's own thread, which may not wait. */
export function threadsHere(wanted: number | "auto"): number {
  const isWorker = typeof (globalThis as { WorkerGlobalScope?: unknown }).WorkerGlobalScope === "function";
  return isWorker || isNode() ? threadsInWorker(wanted) : 1;
}

/** The name of the `BroadcastChannel` of a Worker's threads. */
export function threadsChannel(worker: string): string {
  return `${worker} threads`;
}

/** Lets a build that has just been started run on `count` threads, this one being the first. */
export async function startThreads(core: ThreadedModule, count: number, start: Omit<ThreadStart, "channel">): Promise<void> {
  const channel = threadsChannel((globalThis as { name?: string }).name ?? "");
  const started: Thread[] = [];
  try {
    for (let number = 1; number < count; number++) started.push(nodeThread() ?? browserThread());
    await Promise.all(started.map((thread) => thread.ready({ ...start, channel })));
  } catch (thrown) {
    for (const thread of started) thread.end();
    throw thrown;
  }
  core.startThreads(count);
}

export interface Thread {
  /** Settles when it has started. */
  ready(start: ThreadStart): Promise<void>;
  end(): void;
}

function browserThread(): Thread {
  // The literal form is what bundlers look for.
  const worker = new Worker(new URL("./thread.js", import.meta.url), { type: "module", name: "gravisight thread" });
  return {
    ready: (start) =>
      new Promise((resolve, reject) => {
        worker.addEventListener("message", () => resolve(), { once: true });
        worker.addEventListener("error", (event) => {
          event.preventDefault();
          reject(new GravisightError("worker", `A thread could not start: ${event.message || "is its script, thread.js of this package, served?"}`));
        });
        worker.postMessage(start);
      }),
    end: () => worker.terminate(),
  };
}
