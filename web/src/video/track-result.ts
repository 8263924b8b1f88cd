/** A tracked video: what was found in each frame that the video shows, and the way between the video's times and those of filming. */
import type { Camera, TrackedVideo } from "gravisight";
import type { Curve, FrameDetection } from "./detections";
import { FrameTimes } from "./frame-times";

/** How far back the ball's path is drawn, ms. */
const TRAIL = 1000;

/** What a track is made of: it can be kept and opened again. */
export interface TrackRecord {
  tracked: TrackedVideo;
  /** When the video shows each frame, ms. A video may show a frame twice; when it was filmed, the track says. */
  timesMs: number[];
  /** In metres, if the camera and the place were known. */
  camera: Camera | undefined;
  /** Frames that the browser did not show. */
  missed: number;
  /** Why frames at the end are missing; empty where none are. */
  broken: string;
}

export class TrackResult {
  /** Without those that repeat another. */
  readonly detections: FrameDetection[] = [];
  readonly curve: Curve;
  readonly record: TrackRecord;
  readonly #times: FrameTimes;
  /** One a frame: of a frame that repeats another, the other's. */
  readonly #byFrame: (FrameDetection | undefined)[] = [];

  constructor(record: TrackRecord) {
    const { tracked, timesMs, camera } = record;
    this.record = record;
    this.#times = new FrameTimes(timesMs);
    const axis = camera?.camera_from_world[2] ?? [];
    for (const [index, { time, repeated, image, confidence, world, sigma, explained }] of tracked.frames.entries()) {
      if (repeated) {
        this.#byFrame.push(this.#byFrame.at(-1));
        continue;
      }
      const depth = world && world.reduce((sum, value, row) => sum + value * (axis[row] ?? 0), axis[3] ?? 0);
      const precise = tracked.findings.precise[index] ?? false;
      const timeMs = timesMs[index] ?? 1000 * time;
      const detection = image ? { timeMs, filmed: time, image, confidence, world, depth, sigma, precise, ...(explained !== null && { explained }) } : undefined;
      if (detection) this.detections.push(detection);
      this.#byFrame.push(detection);
    }
    const { findings } = tracked;
    this.curve = curveOf(record.broken ? { ...tracked, findings: { ...findings, notes: [record.broken, ...findings.notes] } } : tracked);
  }

  /** What was found in the frame that the video shows at a time. */
  at(timeMs: number): FrameDetection | undefined {
    return this.#byFrame[this.#times.indexAt(timeMs)];
  }

  /** The frame that the video shows at a time. */
  frameAt(timeMs: number): number {
    return this.#times.indexAt(timeMs);
  }

  /** When the video shows what was filmed at a time (s), ms. */
  shownMs(filmed: number): number {
    const { frames } = this.record.tracked;
    let after = frames.findIndex(({ time, repeated }) => !repeated && time >= filmed);
    if (after < 0) after = frames.length - 1;
    let before = after - 1;
    while (before > 0 && frames[before]?.repeated) before--;
    const [from, to] = [frames[Math.max(before, 0)], frames[after]];
    const [fromMs, toMs] = [this.record.timesMs[Math.max(before, 0)] ?? 0, this.record.timesMs[after] ?? 0];
    if (!from || !to || to.time <= from.time) return toMs;
    const fraction = Math.min(Math.max((filmed - from.time) / (to.time - from.time), 0), 1);
    return fromMs + fraction * (toMs - fromMs);
  }

  /** Detections of the last second before a time, that time's own included. */
  trail(timeMs: number): FrameDetection[] {
    const until = this.#times.startOf(timeMs);
    return this.detections.filter((detection) => detection.timeMs <= until && detection.timeMs > until - TRAIL);
  }
}

/** The flights in the form of a fit to detections. */
function curveOf({ frames, explained, ...all }: TrackedVideo): Curve {
  const fitted = frames.flatMap(({ time, world, speed, sigma, outlier, explained }) =>
    world && speed !== null && sigma !== null ? [{ time, world, speed, sigma, outlier, explained: explained ?? false }] : [],
  );
  return { ...all, explained: explained ?? false, flat: explained === null, frames: fitted };
}
