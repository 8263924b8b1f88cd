/** What is still missing for a camera, under the picture; while it is computed, for how long. */
import type { Parts } from "../shared/panel";

const COMPUTING = "Computing the camera…";
/** Before this, no seconds are counted. */
const PATIENCE = 2;

export class Progress {
  readonly #part: Parts;
  #timer = 0;

  constructor(part: Parts) {
    this.#part = part;
  }

  /** The camera is being computed. */
  start(): void {
    if (this.#timer !== 0) return;
    const since = performance.now();
    this.#show(COMPUTING, true);
    this.#timer = window.setInterval(() => {
      const seconds = Math.floor((performance.now() - since) / 1000);
      this.#show(seconds < PATIENCE ? COMPUTING : `${COMPUTING} ${seconds} s`, true);
    }, 1000);
  }

  /** It is no longer. */
  end(text: string): void {
    clearInterval(this.#timer);
    this.#timer = 0;
    this.#show(text, false);
  }

  #show(text: string, isRunning: boolean): void {
    this.#part("cal-progress").hidden = text === "";
    this.#part("cal-progress").dataset.state = isRunning ? "running" : "";
    this.#part("cal-progress-bar").classList.toggle("unseen-kept", !isRunning);
    this.#part("cal-progress-text").textContent = text;
  }
}
