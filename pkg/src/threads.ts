/** The threads of a build that has them: Workers that share its memory. */
import { GravisightError } from "./error.js";
import { isNode, nodeThread } from "./node.js";
import type { ThreadedModule, ThreadStart } from "./thread.js";
import type { CoreOptions } from "./types.js";

/** Threads that `auto` takes at most: more have too little work each. */
const MOST = 8;

/** @throws {@link GravisightError} `threads`. */
export function checkedThreads(threads: CoreOptions["threads"]): number | "auto" {
  if (threads === undefined) return 1;
  if (threads === "auto" || (Number.isInteger(threads) && threads >= 1)) return threads;
  throw new GravisightError("threads", `threads is ${JSON.stringify(threads)}; it must be "auto" or a whole number of 1 or more.`);
}

/** How many threads an engine can have in a Worker of this page, or in Node.js: one where memory cannot be shared. */
export function threadsInWorker(requested: number | "auto"): number {
  const isolated = (globalThis as { crossOriginIsolated?: boolean }).crossOriginIsolated !== false && typeof SharedArrayBuffer === "function";
  if (!isolated) return 1;
  return requested === "auto" ? Math.min(globalThis.navigator?.hardwareConcurrency ?? 1, MOST) : requested;
}

/** Whether an object's engine runs on the calling thread: where that is requested, and in Node.js unless it needs threads. */
export function runsHere({ worker, threads }: Pick<CoreOptions, "worker" | "threads">): boolean {
  if (worker !== undefined) return worker === false;
  if (typeof Worker !== "undefined") return false;
  return !isNode() || threadsInWorker(checkedThreads(threads)) === 1;
}

/**
 * The threads of an object's engine. One on the calling thread: that thread would wait for the others, and nobody would be left to
 * hear that one of them trapped.
 */
export function threadsOf(options: Pick<CoreOptions, "worker" | "threads">): number | "auto" {
  const threads = checkedThreads(options.threads);
  return runsHere(options) ? 1 : threads;
}

/** Drawn, since several Workers of one origin may have threads. */
let channel: string | undefined;

/** The name of the `BroadcastChannel` on which this thread's own threads tell that they failed. */
export function threadsChannel(): string {
  return (channel ??= `gravisight threads ${crypto.getRandomValues(new Uint32Array(4)).join("-")}`);
}

/** Lets a build that has just been started run on `count` threads, this one being the first. */
export async function startThreads(core: ThreadedModule, count: number, start: Omit<ThreadStart, "channel">): Promise<void> {
  const started: Thread[] = [];
  try {
    for (let number = 1; number < count; number++) started.push(nodeThread() ?? browserThread());
    await Promise.all(started.map((thread) => thread.ready({ ...start, channel: threadsChannel() })));
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
          reject(new GravisightError("worker", `A thread could not start: ${event.message || "is this package's thread.js being served?"}`));
        });
        worker.postMessage(start);
      }),
    end: () => worker.terminate(),
  };
}
