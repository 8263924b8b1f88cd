/** The position in the frame that is shown, and what is known of all frames together. */
import type { Parts } from "../shared/panel";
import { average, type FrameDetection } from "./detections";
import type { Units } from "./units";

export class Numbers {
  readonly #part: Parts;
  units: Units;

  constructor(part: Parts, units: Units) {
    this.#part = part;
    this.units = units;
  }

  show(detection: FrameDetection, isSure: boolean): void {
    const isKnown = detection.explained !== false;
    for (const [axis, name] of ["video-x", "video-y", "video-z"].entries()) {
      const metres = isKnown ? detection.world?.[axis] : undefined;
      this.#set(name, metres ?? "", metres === undefined ? "–" : (this.units.length.per * metres).toFixed(2).replace("-", "−"));
    }
    this.#part("video-position").classList.toggle("vague", detection.precise === false);
    this.#set("video-pixel", detection.image.join(" "), `${detection.image.map((px) => px.toFixed(1)).join(", ")} px`);
    this.#part("video-sigma-row").hidden = detection.sigma === null || !isKnown;
    this.#set("video-sigma", detection.sigma ?? "", detection.sigma === null ? "–" : `± ${length(detection.sigma, this.units)}`);
    this.#set("video-confidence", detection.confidence, `${(100 * detection.confidence).toFixed(0)} %${isSure ? "" : " – not sure"}`);
    this.#setError("video-error", detection.dtg);
  }

  /** Of the frames whose position is sure, where the truth is known. */
  showMean(sure: FrameDetection[]): void {
    this.#setError("video-mean-error", average(sure.flatMap(({ dtg }) => dtg ?? [])));
  }

  showCounts(looked: number, skipped: number, milliseconds: number | undefined, isLive: boolean): void {
    this.#set("video-processed", looked, String(looked));
    this.#set("video-skipped", skipped, String(skipped));
    this.#part("video-skipped-note").hidden = skipped === 0 || isLive;
    this.#part("video-ms-row").hidden = milliseconds === undefined;
    this.#set("video-ms", milliseconds ?? "", milliseconds === undefined ? "–" : `${milliseconds.toFixed(1)} ms`);
  }

  clear(): void {
    for (const name of ["video-x", "video-y", "video-z", "video-sigma", "video-pixel", "video-confidence"]) this.#set(name, "", "–");
    this.showReason("");
    for (const name of ["video-error", "video-mean-error"]) this.#setError(name, undefined);
  }

  /** Why there is no position; empty if there is one. */
  showReason(reason: string): void {
    const place = this.#part("video-no-position");
    place.textContent = reason;
    place.hidden = reason === "";
  }

  #setError(name: string, metres: number | undefined): void {
    this.#part(`${name}-row`).hidden = metres === undefined;
    this.#set(name, metres ?? "", metres === undefined ? "–" : `${(100 * metres).toFixed(1)} cm`);
  }

  #set(name: string, value: number | string, text: string): void {
    const data = this.#part<HTMLDataElement>(name);
    data.value = String(value);
    data.textContent = text;
  }
}

/** In the usual unit of such a length. */
function length(metres: number, { length: unit }: Units): string {
  if (unit.per !== 1) return `${(unit.per * metres).toFixed(metres < 1 ? 2 : 1)} ${unit.name}`;
  return metres < 1 ? `${(100 * metres).toFixed(metres < 0.1 ? 1 : 0)} cm` : `${metres.toFixed(1)} m`;
}
