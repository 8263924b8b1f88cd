/** The detections, frame by frame, in the order of time. */
import type { Fit, FittedFrame, Localisation, Vector } from "gravisight";

export interface FrameDetection {
  /** When the video shows it. */
  timeMs: number;
  /** When it was filmed, s; where that is not known, when the video shows it. */
  filmed: number;
  image: [number, number];
  /** Null, as the position, where it is not known. */
  depth: number | null;
  world: Vector | null;
  /** Root mean square error of the position to expect, metres; null where it is not known. */
  sigma: number | null;
  /** Whether that is little enough for the position to be read as a fact; undefined where that is not known. */
  precise?: boolean;
  /** Whether its flight is explained: if not, the position is not known; undefined where it is of no flight. */
  explained?: boolean;
  confidence: number;
  truth?: Vector;
  /** Distance to the truth, metres. */
  dtg?: number;
}

/** Flights: of a fit to detections, or of a tracked video. */
export interface Curve extends Pick<Fit, "explained" | "findings" | "flights" | "impacts" | "hits"> {
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

export class FrameDetections {
  readonly all: FrameDetection[] = [];
  /** Rises with every frame that is new. */
  version = 0;

  at(timeMs: number): FrameDetection | undefined {
    const detection = this.all[this.#index(timeMs)];
    return detection && detection.timeMs - timeMs < SAME ? detection : undefined;
  }

  add(timeMs: number, { image, depth, world, covariance, confidence, dtg }: Localisation, truth?: Vector): FrameDetection {
    const sigma = covariance ? Math.sqrt(covariance.reduce((sum, row, axis) => sum + (row[axis] ?? 0), 0)) : null;
    const detection: FrameDetection = { timeMs, filmed: timeMs / 1000, image, depth, world, sigma, confidence, ...(truth && { truth }), ...(dtg !== undefined && { dtg }) };
    const index = this.#index(timeMs);
    const again = this.at(timeMs) !== undefined;
    this.all.splice(index, again ? 1 : 0, detection);
    if (!again) this.version++;
    return detection;
  }

  /** Takes what was found in all frames at once. */
  replace(all: FrameDetection[]): void {
    this.all.splice(0, this.all.length, ...all);
    this.version++;
  }

  clear(): void {
    this.all.length = 0;
    this.version++;
  }

  /** Index of the first one that is not before a time; most often there is none. */
  #index(timeMs: number): number {
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
