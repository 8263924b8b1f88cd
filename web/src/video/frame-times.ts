/** When the frames of a video are shown, so that any time leads to the frame that is on the screen then. */
import { SAME } from "./detections";

export class FrameTimes {
  readonly #timesMs: number[];

  /** Increasing; at least one. */
  constructor(timesMs: number[]) {
    this.#timesMs = timesMs;
  }

  /** The frame that is shown at a time; the first one before it starts. */
  indexAt(timeMs: number): number {
    let low = 0;
    let high = this.#timesMs.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.#timesMs[middle]! <= timeMs + SAME) low = middle + 1;
      else high = middle;
    }
    return Math.max(0, low - 1);
  }

  /** When the frame that is shown at a time begins. */
  startOf(timeMs: number): number {
    return this.#timesMs[this.indexAt(timeMs)] ?? timeMs;
  }

  /** The middle of a frame's time: a player that is sent there shows that frame, however it rounds. Clamped to the first and the last frame. */
  middleOf(index: number): number {
    const last = this.#timesMs.length - 1;
    const within = Math.min(Math.max(index, 0), last);
    const start = this.#timesMs[within] ?? 0;
    const length = within < last ? (this.#timesMs[within + 1] ?? start) - start : start - (this.#timesMs[within - 1] ?? start);
    return start + length / 2;
  }
}
