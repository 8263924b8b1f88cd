/** What plays, stops and steps a source, and shows where it is. */
import type { Parts } from "../shared/panel";
import type { Source } from "./sources";

export class Transport {
  readonly #part: Parts;
  readonly #time: HTMLInputElement;
  readonly #rate: HTMLSelectElement;
  #source: Source | undefined;

  constructor(part: Parts) {
    this.#part = part;
    this.#time = part<HTMLInputElement>("video-time");
    this.#rate = part<HTMLSelectElement>("video-rate");
    part("video-back").addEventListener("click", () => this.#source?.step(-1));
    part("video-forward").addEventListener("click", () => this.#source?.step(1));
    this.#time.addEventListener("input", () => this.#source?.seek(Number(this.#time.value)));
    this.#rate.addEventListener("change", () => this.#source?.setRate(Number(this.#rate.value)));
  }

  /** Serves another source, or none. */
  open(source: Source | undefined): void {
    this.#source = source;
    source?.setRate(Number(this.#rate.value));
    const isLive = source?.kind === "webcam";
    const moves = source !== undefined && source.durationMs > 0;
    this.#part("video-transport").hidden = !moves;
    for (const name of ["video-back", "video-forward", "video-time", "video-rate-label"]) this.#part(name).hidden = isLive;
    this.#time.max = String(isLive ? 0 : (source?.durationMs ?? 0));
    const stop = this.#part("video-stop");
    stop.hidden = !source;
    stop.textContent = isLive ? "Stop the webcam" : "Close";
    this.showState();
  }

  showState(): void {
    const playing = this.#source?.playing ?? false;
    const button = this.#part("video-play");
    button.dataset.playing = String(playing);
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  showTime(timeMs: number): void {
    const text = `${(timeMs / 1000).toFixed(2)} s`;
    this.#time.value = String(timeMs);
    this.#time.setAttribute("aria-valuetext", text);
    this.#part("video-clock").textContent = text;
  }
}
