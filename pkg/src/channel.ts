/** An object's end of its Worker: request ids, one request in flight, the others wait their turn. */
import { GravisightError, messageOf } from "./error.js";
import { nodeWorker } from "./node.js";
import type { Answer, CallName, CallOptions, FromWorker, Request, ToWorker, Transport } from "./protocol.js";
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

/** How long a Worker in which something failed may take to say that it is there, ms. */
const MOST_SILENCE = 5000;

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
  /** Whether the Worker has sent anything yet. */
  #isHere = false;

  /** Through `worker`, which the user starts and ends and which may serve other objects; or through one of its own. */
  constructor(worker?: Worker) {
    this.#owned = worker === undefined;
    this.#worker = worker ?? ownWorker(this.#object);
    const { signal } = this.#listening;
    // Not `onmessage` and the like: in a Worker of the user's these are the user's.
    this.#worker.addEventListener("message", (event: MessageEvent<FromWorker>) => this.#receive(event.data), { signal });
    this.#worker.addEventListener(
      "error",
      (event) => {
        // A script that is not there comes without a message.
        if (this.#owned || !event.message) {
          event.preventDefault();
          return this.#closeSince(event.message || "is this package's worker.js being served?");
        }
        // An error of the user's own code is none of ours, unless the Worker does not even answer.
        if (this.#isHere) return;
        this.#post({ type: "hello", object: this.#object });
        setTimeout(() => !this.#isHere && this.#closeSince(event.message), MOST_SILENCE);
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
        if (this.#inFlight?.id === id) this.#inFlight.onProgress = undefined;
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

  #closeSince(reason: string): void {
    this.close(new GravisightError("worker", `The Worker failed to start, or stopped: ${reason}`));
  }

  /** A Worker that waits for one of its threads cannot tell that this has trapped. */
  #listenToThreads(channel: string): void {
    if (this.#isHere || typeof BroadcastChannel !== "function") return;
    const { signal } = this.#listening;
    const threads = new BroadcastChannel(channel);
    // In Node.js a channel would keep the program alive.
    (threads as { unref?(): void }).unref?.();
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
      next.reject(new GravisightError("worker", `The request cannot be sent: ${messageOf(thrown)}.`, { cause: thrown }));
      this.#sendNext();
    }
  }

  #receive(message: FromWorker | null): void {
    if (message?.object !== this.#object) return;
    if (message.type === "here") {
      this.#listenToThreads(message.threads);
      this.#isHere = true;
      return;
    }
    const pending = this.#inFlight;
    if (!pending || message.id !== pending.id) return;
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

function ownWorker(name: string): Worker {
  if (typeof Worker === "undefined") return nodeWorker();
  // The literal form is what bundlers look for.
  return new Worker(new URL("./worker.js", import.meta.url), { type: "module", name });
}
