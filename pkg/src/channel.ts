/** An object's end of its Worker: request ids, one request in flight, the others wait their turn. */
import { GravisightError, wordsOf } from "./error.js";
import type { Answer, CallName, CallOptions, FromWorker, Request, ToWorker, Transport } from "./protocol.js";
import { threadsChannel } from "./threads.js";
import type { Progress } from "./types.js";

interface Pending {
  id: number;
  type: CallName;
  request: Request<CallName>;
  transfer: Transferable[];
  onProgress: ((progress: Progress) => void) | undefined;
  resolve: (answer: never) => void;
  reject: (reason: unknown) => void;
}

export class Channel implements Transport {
  readonly #worker: Worker;
  /** Whether the Worker serves nobody else, and ends with this. */
  readonly #owned: boolean;
  /** Drawn: two copies of this package may share a Worker. */
  readonly #object = `gravisight ${crypto.getRandomValues(new Uint32Array(4)).join("-")}`;
  #nextId = 0;
  readonly #listening = new AbortController();
  #waiting: Pending[] = [];
  #inFlight: Pending | undefined;
  #closedBecause: unknown;

  /** Through `worker`, which the user starts and ends and which may serve other objects; or through one of its own. */
  constructor(worker?: Worker) {
    this.#owned = worker === undefined;
    // The literal form is what bundlers look for.
    this.#worker = worker ?? new Worker(new URL("./worker.js", import.meta.url), { type: "module", name: this.#object });
    const { signal } = this.#listening;
    this.#listenToThreads(signal);
    // Not `onmessage` and the like: in a Worker of the user's these are the user's.
    this.#worker.addEventListener("message", (event: MessageEvent<FromWorker>) => this.#receive(event.data), { signal });
    this.#worker.addEventListener(
      "error",
      (event) => {
        event.preventDefault();
        // A script that is not there comes without a message.
        const reason = event.message || "is its script, worker.js of this package, served?";
        this.close(new GravisightError("worker", `The Worker could not start or stopped: ${reason}`));
      },
      { signal },
    );
    this.#worker.addEventListener("messageerror", () => this.close(new GravisightError("worker", "A message from the Worker could not be read.")), { signal });
  }

  /** Sends a request and waits for its answer. An aborted request rejects at once and its answer is dropped. */
  call<K extends CallName>(type: K, request: Request<K>, options: CallOptions = {}): Promise<Answer<K>> {
    return new Promise((resolve, reject) => {
      const { signal } = options;
      if (this.#closedBecause !== undefined) return reject(this.#closedBecause);
      if (signal?.aborted) return reject(signal.reason);
      const id = this.#nextId++;
      const abort = () => {
        this.#waiting = this.#waiting.filter((pending) => pending.id !== id);
        reject(signal?.reason);
      };
      const settled = () => signal?.removeEventListener("abort", abort);
      signal?.addEventListener("abort", abort, { once: true });
      this.#waiting.push({
        id,
        type,
        request,
        transfer: options.transfer ?? [],
        onProgress: options.onProgress,
        resolve: (answer) => (settled(), resolve(answer)),
        reject: (reason) => (settled(), reject(reason)),
      });
      this.#sendNext();
    });
  }

  /** Throws the reason of {@link close}. */
  throwIfClosed(): void {
    if (this.#closedBecause !== undefined) throw this.#closedBecause;
  }

  /** Ends a Worker of its own, and frees the object in one of the user's; every request that waits, and every later one, rejects with `reason`. */
  close(reason: unknown): void {
    if (this.#closedBecause !== undefined) return;
    this.#closedBecause = reason;
    this.#listening.abort();
    if (this.#owned) this.#worker.terminate();
    else this.#post({ type: "close", object: this.#object });
    this.#inFlight?.reject(reason);
    for (const pending of this.#waiting) pending.reject(reason);
    this.#inFlight = undefined;
    this.#waiting = [];
  }

  /** A Worker that waits for one of its threads cannot tell that this has trapped. */
  #listenToThreads(signal: AbortSignal): void {
    if (!this.#owned || typeof BroadcastChannel !== "function") return;
    const threads = new BroadcastChannel(threadsChannel(this.#object));
    threads.addEventListener("message", ({ data }) => this.close(new GravisightError("internal", `A thread of the core failed: ${data}`)), { signal });
    signal.addEventListener("abort", () => threads.close());
  }

  #post(message: ToWorker, transfer: Transferable[] = []): void {
    this.#worker.postMessage(message, transfer);
  }

  #sendNext(): void {
    if (this.#inFlight) return;
    const next = this.#waiting.shift();
    if (!next) return;
    try {
      this.#post({ type: next.type, object: this.#object, id: next.id, request: next.request } as ToWorker, next.transfer);
      this.#inFlight = next;
    } catch (thrown) {
      next.reject(new GravisightError("worker", `The request cannot be sent: ${wordsOf(thrown)}.`, { cause: thrown }));
      this.#sendNext();
    }
  }

  #receive(message: FromWorker | null): void {
    const pending = this.#inFlight;
    if (!pending || message?.object !== this.#object || message.id !== pending.id) return;
    if (message.type === "progress") {
      pending.onProgress?.(message.progress);
      return;
    }
    this.#inFlight = undefined;
    if (message.type === "done") pending.resolve(message.answer as never);
    else pending.reject(new GravisightError(message.code, message.message));
    this.#sendNext();
  }
}
