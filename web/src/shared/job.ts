/** A long job: shown with a message and progress, and a button to cancel it. */
import { make } from "../dom";

/** A job's reports, and the signal that ends it. */
export interface Watch {
  signal: AbortSignal;
  /** `of` is null where nobody knows how much there is; without a message the last one stays. */
  progress(done: number, of: number | null, message?: string): void;
}

export class Job {
  readonly #place: HTMLElement;
  readonly #message = make("span");
  readonly #bar = make("progress");
  #running: AbortController | undefined;

  constructor(place: HTMLElement, name: string) {
    this.#place = place;
    this.#message.setAttribute("role", "status");
    this.#bar.setAttribute("aria-label", "Progress");
    const cancel = make("button", { class: "button", text: "Cancel", part: name });
    cancel.type = "button";
    cancel.addEventListener("click", () => this.abort());
    place.classList.add("card", "job");
    place.hidden = true;
    place.append(this.#message, this.#bar, cancel);
  }

  get isRunning(): boolean {
    return this.#running !== undefined;
  }

  abort(): void {
    this.#running?.abort();
  }

  /** Runs `work`, in place of what runs now; throws an abort as soon as it is ended. */
  async run<T>(message: string, work: (watch: Watch) => Promise<T>): Promise<T> {
    this.abort();
    const job = (this.#running = new AbortController());
    const progress: Watch["progress"] = (done, of, message) => {
      if (this.#running !== job) return;
      if (of) {
        this.#bar.max = of;
        this.#bar.value = done;
      } else this.#bar.removeAttribute("value");
      if (message) this.#message.textContent = message;
    };
    progress(0, null, message);
    this.#place.hidden = false;
    const stopped = new Promise<never>((_, reject) => {
      job.signal.addEventListener("abort", () => reject(job.signal.reason as Error));
    });
    try {
      return await Promise.race([work({ signal: job.signal, progress }), stopped]);
    } finally {
      if (this.#running === job) {
        this.#running = undefined;
        this.#place.hidden = true;
      }
    }
  }
}
