/** An object's engine on the caller's own thread: in the Worker, in Node.js, in a Worker that uses the package itself. */
import { errorOfCore } from "./builds.js";
import { Engine } from "./engine.js";
import type { Answer, CallName, CallOptions, Request, Transport } from "./protocol.js";
import { watchForTraps } from "./trap.js";

export class Inline implements Transport {
  readonly #engine = new Engine();
  #last: Promise<unknown> = Promise.resolve();
  #closedBecause: unknown;

  constructor() {
    if (typeof globalThis.addEventListener !== "function") return;
    watchForTraps(globalThis, errorOfCore);
  }

  async call<K extends CallName>(type: K, request: Request<K>, options: CallOptions = {}): Promise<Answer<K>> {
    const { signal, onProgress } = options;
    this.throwIfClosed();
    signal?.throwIfAborted();
    const answer = this.#last.then(() => {
      this.throwIfClosed();
      signal?.throwIfAborted();
      return this.#engine.call(type, request, (progress) => {
        if (!signal?.aborted && this.#closedBecause === undefined) hear(() => onProgress?.(progress));
      });
    });
    this.#last = answer.catch(() => {});
    return signal ? await until(answer, signal) : await answer;
  }

  /** Whether there is such a call. */
  knows(type: string): type is CallName {
    return this.#engine.knows(type);
  }

  throwIfClosed(): void {
    if (this.#closedBecause !== undefined) throw this.#closedBecause;
  }

  close(reason: unknown): void {
    if (this.#closedBecause !== undefined) return;
    this.#closedBecause = reason;
    // What is under way still uses the memory.
    this.#last = this.#last.then(() => this.#engine.free());
  }
}

/** `work`, or the reason of `signal`. */
function until<T>(work: Promise<T>, signal: AbortSignal): Promise<T> {
  return new Promise((resolve, reject) => {
    const abort = () => reject(signal.reason);
    signal.addEventListener("abort", abort, { once: true });
    work.then(resolve, reject).finally(() => signal.removeEventListener("abort", abort));
  });
}

/** Calls a listener of the user's. What it throws is uncaught, as from any listener, and does not end the work. */
function hear(listener: () => void): void {
  try {
    listener();
  } catch (thrown) {
    queueMicrotask(() => {
      throw thrown;
    });
  }
}
