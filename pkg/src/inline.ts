/** An engine on the caller's own thread: for Node.js, and for Workers that the user brings. */
import { Engine } from "./engine.js";
import type { Answer, CallName, CallOptions, Request, Transport } from "./protocol.js";
import { watchForTraps } from "./trap.js";

let watched = false;

export class Inline implements Transport {
  readonly #engine = new Engine();
  #last: Promise<unknown> = Promise.resolve();
  #closedBecause: unknown;

  constructor() {
    if (watched || typeof globalThis.addEventListener !== "function") return;
    watched = true;
    // Errors of the user's own code are none of ours.
    watchForTraps(globalThis, (thrown) => thrown instanceof WebAssembly.RuntimeError);
  }

  async call<K extends CallName>(type: K, request: Request<K>, options: CallOptions = {}): Promise<Answer<K>> {
    const { signal, onProgress } = options;
    this.throwIfClosed();
    signal?.throwIfAborted();
    const turn = this.#last.then(() => {
      this.throwIfClosed();
      signal?.throwIfAborted();
      return this.#engine.call(type, request, onProgress ?? (() => {}));
    });
    this.#last = turn.catch(() => {});
    return signal ? await until(turn, signal) : await turn;
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
