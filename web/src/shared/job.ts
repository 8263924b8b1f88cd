/** A long job: shown with words and progress, and a way to end it. */
import { make } from "../dom";

/** What a job tells, and when it is to end. */
export interface Watch {
  signal: AbortSignal;
  /** `of` is null where nobody knows how much there is; no words keep the last ones. */
  progress(done: number, of: number | null, words?: string): void;
}

export class Job {
  readonly #place: HTMLElement;
  readonly #words = make("span");
  readonly #bar = make("progress");
  #running: AbortController | undefined;

  constructor(place: HTMLElement, name: string) {
    this.#place = place;
    this.#words.setAttribute("role", "status");
    this.#bar.setAttribute("aria-label", "Progress");
    const cancel = make("button", { class: "button", text: "Cancel", part: name });
    cancel.type = "button";
    cancel.addEventListener("click", () => this.abort());
    place.classList.add("card", "job");
    place.hidden = true;
    place.append(this.#words, this.#bar, cancel);
  }

  get isRunning(): boolean {
    return this.#running !== undefined;
  }

  abort(): void {
    this.#running?.abort();
  }

  /** Runs `work`, in place of what runs now; throws an abort as soon as it is ended. */
  async run<T>(words: string, work: (watch: Watch) => Promise<T>): Promise<T> {
    this.abort();
    const job = (this.#running = new AbortController());
    const progress: Watch["progress"] = (done, of, more) => {
      if (this.#running !== job) return;
      if (of) {
        this.#bar.max = of;
        this.#bar.value = done;
      } else this.#bar.removeAttribute("value");
      if (more) this.#words.textContent = more;
    };
    progress(0, null, words);
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
