/** What was found, frame by frame, in the order of time. */
import type { Localisation, Vector } from "gravisight";

export interface Seen {
  timeMs: number;
  image: [number, number];
  depth: number;
  world: Vector;
  confidence: number;
  truth?: Vector;
  /** Distance to the truth, metres. */
  dtg?: number;
}

/** Two times that are closer are of one frame, in milliseconds. */
export const SAME = 0.5;

/** Undefined of nothing. */
export function average(values: number[]): number | undefined {
  return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : undefined;
}

export class Sightings {
  readonly all: Seen[] = [];
  /** Rises with every frame that is new. */
  version = 0;

  at(timeMs: number): Seen | undefined {
    const seen = this.all[this.#place(timeMs)];
    return seen && seen.timeMs - timeMs < SAME ? seen : undefined;
  }

  add(timeMs: number, { image, depth, world, confidence, dtg }: Localisation, truth?: Vector): Seen {
    const seen: Seen = { timeMs, image, depth, world, confidence, ...(truth && { truth }), ...(dtg !== undefined && { dtg }) };
    const place = this.#place(timeMs);
    const again = this.at(timeMs) !== undefined;
    this.all.splice(place, again ? 1 : 0, seen);
    if (!again) this.version++;
    return seen;
  }

  clear(): void {
    this.all.length = 0;
    this.version++;
  }

  /** Of the first one that is not before; most often there is none. */
  #place(timeMs: number): number {
    let low = 0;
    let high = this.all.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.all[middle]!.timeMs < timeMs - SAME) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
