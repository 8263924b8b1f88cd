/** What was found, frame by frame, in the order of time. */
import type { Fit, FittedFrame, Localisation, Vector } from "gravisight";

export interface Seen {
  timeMs: number;
  image: [number, number];
  /** Null, as the position, where it is not known. */
  depth: number | null;
  world: Vector | null;
  /** Root mean square error of the position to expect, metres; null where nobody says it. */
  sigma: number | null;
  /** Whether that is little enough for the position to be read as a fact; undefined where nobody says it. */
  precise?: boolean;
  /** Whether its flight is explained: if not, the position is not known; undefined where it is of no flight. */
  explained?: boolean;
  confidence: number;
  truth?: Vector;
  /** Distance to the truth, metres. */
  dtg?: number;
}

/** Flights: of a fit to sightings, or of a tracked video. */
export interface Curve extends Pick<Fit, "explained" | "findings" | "impacts" | "hits"> {
  frames: Pick<FittedFrame, "time" | "world" | "speed" | "sigma" | "outlier" | "explained">[];
  /** Whether it is in pixels alone: the camera or the place is not known. */
  flat: boolean;
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

  add(timeMs: number, { image, depth, world, covariance, confidence, dtg }: Localisation, truth?: Vector): Seen {
    const sigma = covariance ? Math.sqrt(covariance.reduce((sum, row, axis) => sum + (row[axis] ?? 0), 0)) : null;
    const seen: Seen = { timeMs, image, depth, world, sigma, confidence, ...(truth && { truth }), ...(dtg !== undefined && { dtg }) };
    const place = this.#place(timeMs);
    const again = this.at(timeMs) !== undefined;
    this.all.splice(place, again ? 1 : 0, seen);
    if (!again) this.version++;
    return seen;
  }

  /** Takes what was found in all frames at once. */
  replace(all: Seen[]): void {
    this.all.splice(0, this.all.length, ...all);
    this.version++;
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
