/** Where a person saw the ball: by a click or by keys, listed, taken back. */
import { make, textButton } from "../dom";
import { arrow, inside } from "../shared/picture-view";
import type { Overlay } from "../shared/overlay";
import type { Parts } from "../shared/panel";
import type { Pixel } from "../shared/canvas";
import type { FrameSearch } from "./frame-search";
import type { Correction } from "./tracking";

/** Pixels that an arrow key moves the cross by; with Shift. */
const STEP = 1;
const STRIDE = 10;

interface With {
  part: Parts;
  overlay: Overlay;
  frameSearch: FrameSearch;
}

export class Corrections {
  readonly #with: With;
  readonly #changed: () => Promise<void>;
  #all: Correction[] = [];
  /** Where the cross is that keys move. */
  #cross: Pixel | undefined;

  /** `changed` makes the track anew. */
  constructor(uses: With, changed: () => Promise<void>) {
    this.#with = uses;
    this.#changed = changed;
  }

  get all(): Correction[] {
    return [...this.#all];
  }

  restore(all: Correction[]): void {
    this.#all = [...all];
    this.#aim(undefined);
    this.#list();
  }

  /** A click on the picture says where the ball is in the frame that is shown. */
  async click(event: MouseEvent): Promise<void> {
    const { part, frameSearch } = this.#with;
    const { source, result } = frameSearch;
    if (!source || !result) return;
    const { left, top, width, height } = part("video-overlay").getBoundingClientRect();
    const at = (fraction: number, all: number) => fraction * all - 0.5;
    await this.#add([at((event.clientX - left) / width, source.width), at((event.clientY - top) / height, source.height)]);
  }

  /** Enter takes up a cross at the ring, arrows move it, Enter puts it down, Escape drops it; true if the key was of use. */
  key(event: KeyboardEvent): Promise<void> | boolean {
    const { frameSearch, part } = this.#with;
    const { source, result } = frameSearch;
    if (!source?.current || !result || document.activeElement !== part("video-overlay")) return false;
    if (event.key === "Enter") {
      const cross = this.#cross;
      if (cross) return this.#add(cross);
      this.#aim(result.at(source.current.timeMs)?.image ?? [(source.width - 1) / 2, (source.height - 1) / 2]);
      return true;
    }
    if (!this.#cross) return false;
    if (event.key === "Escape") this.#aim(undefined);
    const direction = arrow(event.key);
    const by = event.shiftKey ? STRIDE : STEP;
    if (direction) this.#aim(inside([this.#cross[0] + by * direction[0], this.#cross[1] + by * direction[1]], source));
    return direction !== undefined || event.key === "Escape";
  }

  #aim(at: Pixel | undefined): void {
    this.#cross = at;
    this.#with.overlay.aim(at);
  }

  async #add(image: Pixel): Promise<void> {
    const { source, result } = this.#with.frameSearch;
    if (!source?.current || !result) return;
    const frame = result.frameAt(source.current.timeMs);
    this.#aim(undefined);
    this.#all = [...this.#all.filter((correction) => correction.frame !== frame), { frame, image }];
    this.#list();
    await this.#changed();
  }

  async #remove(correction: Correction): Promise<void> {
    this.#all = this.#all.filter((other) => other !== correction);
    this.#list();
    await this.#changed();
  }

  /** Takes back the last one. */
  async undo(): Promise<void> {
    const last = this.#all.at(-1);
    if (last) await this.#remove(last);
  }

  #list(): void {
    const { part, frameSearch } = this.#with;
    part("video-corrections").hidden = this.#all.length === 0;
    const rows = this.#all.map((correction) => {
      const { frame, image } = correction;
      const where = image.map((px) => px.toFixed(0)).join(", ");
      const timeMs = frameSearch.result?.record.timesMs[frame] ?? 0;
      const goTo = textButton(`Frame ${frame + 1}`, "video-correction", `Go to frame ${frame + 1}`, () => frameSearch.source?.seek(timeMs));
      const remove = textButton("Remove", "video-correction-remove", `Remove the correction in frame ${frame + 1}`, () => void this.#remove(correction));
      return make("li", {}, goTo, make("span", { text: `: the ball is at pixel ${where}. ` }), remove);
    });
    part("video-correction-list").replaceChildren(...rows);
  }
}
