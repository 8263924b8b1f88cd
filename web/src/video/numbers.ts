/** The position in the frame that is shown, and what is known of all frames together. */
import type { Parts } from "../shared/panel";
import { average, type Seen } from "./sightings";

export class Numbers {
  readonly #part: Parts;

  constructor(part: Parts) {
    this.#part = part;
  }

  show(seen: Seen, isSure: boolean): void {
    const isKnown = seen.explained !== false;
    for (const [axis, name] of ["video-x", "video-y", "video-z"].entries()) {
      const metres = isKnown ? seen.world?.[axis] : undefined;
      this.#set(name, metres ?? "", metres === undefined ? "–" : metres.toFixed(2).replace("-", "−"));
    }
    this.#part("video-position").classList.toggle("vague", seen.precise === false);
    this.#set("video-pixel", seen.image.join(" "), `${seen.image.map((px) => px.toFixed(1)).join(", ")} px`);
    this.#part("video-sigma-row").hidden = seen.sigma === null || !isKnown;
    this.#set("video-sigma", seen.sigma ?? "", seen.sigma === null ? "–" : `± ${length(seen.sigma)}`);
    this.#set("video-confidence", seen.confidence, `${(100 * seen.confidence).toFixed(0)} %${isSure ? "" : " – not sure"}`);
    this.#setError("video-error", seen.dtg);
  }

  /** Of the frames whose position is sure, where the truth is known. */
  showMean(sure: Seen[]): void {
    this.#setError("video-mean-error", average(sure.flatMap(({ dtg }) => dtg ?? [])));
  }

  showCounts(looked: number, skipped: number, milliseconds: number | undefined, isLive: boolean): void {
    this.#set("video-processed", looked, String(looked));
    this.#set("video-skipped", skipped, String(skipped));
    this.#part("video-skipped-note").hidden = skipped === 0 || isLive;
    this.#set("video-ms", milliseconds ?? "", milliseconds === undefined ? "–" : `${milliseconds.toFixed(1)} ms`);
  }

  clear(): void {
    for (const name of ["video-x", "video-y", "video-z", "video-sigma", "video-pixel", "video-confidence"]) this.#set(name, "", "–");
    this.showReason("");
    for (const name of ["video-error", "video-mean-error"]) this.#setError(name, undefined);
  }

  /** Why there is no position, in words; of no words there is one. */
  showReason(words: string): void {
    const place = this.#part("video-no-position");
    place.textContent = words;
    place.hidden = words === "";
  }

  #setError(name: string, metres: number | undefined): void {
    this.#part(`${name}-row`).hidden = metres === undefined;
    this.#set(name, metres ?? "", metres === undefined ? "–" : `${(100 * metres).toFixed(1)} cm`);
  }

  #set(name: string, value: number | string, words: string): void {
    const data = this.#part<HTMLDataElement>(name);
    data.value = String(value);
    data.textContent = words;
  }
}

/** In the unit that people would say it in. */
function length(metres: number): string {
  return metres < 1 ? `${(100 * metres).toFixed(metres < 0.1 ? 1 : 0)} cm` : `${metres.toFixed(1)} m`;
}
