/** The ball through a whole source: every frame is given to a tracker, which is kept for what a person corrects. */
import { VideoTracker, type Camera, type DeviceChoice, type Model, type Picture, type Scene } from "gravisight";
import type { Watch } from "../shared/job";
import { PictureSource, type Frame, type Source } from "./sources";
import { TrackResult } from "./track-result";
import { VideoSource } from "./video-source";

/** Frames that wait for the tracker, above which the video pauses, and below which it goes on. */
const MOST_WAITING = 3;
const FEW_WAITING = 1;
/** Speeds at which a video is played to be tracked: the first one, and the slowest that browsers know. */
const FIRST_RATE = 0.25;
const SLOWEST = 0.0625;
/** Fraction of the time between two frames that the tracker may take; and what is left of the speed after a frame was missed. */
const BUSY = 0.7;
/** A video that plays and whose clock stands for so long has ended, though the browser does not say so (one that was cut off), milliseconds. */
const LONGEST_STANDSTILL = 5000;
const SLOWER = 0.7;

/** Without camera and scene the ball is tracked in pixels. */
export interface Known {
  camera: Camera | undefined;
  /** How unsure that is: `oneSigma` of its calibration. */
  cameraSigma: Camera[];
  /** Whether it is assumed and not measured. */
  cameraAssumed: boolean;
  scene: Scene | undefined;
  /** Whose lines the video shows. */
  court: string | undefined;
}

/** Where a person saw the ball. */
export interface Correction {
  /** The frame's number. */
  frame: number;
  /** The ball's centre, pixels. */
  image: [number, number];
}

export class Tracking {
  readonly #tracker: VideoTracker;
  #known: Known;
  /** When the video shows the frames, milliseconds. */
  readonly #times: number[] = [];
  /** Frames that the browser did not show. */
  missed = 0;
  /** Why frames at the end are missing; empty where none are. */
  broken = "";
  /** Where a person saw the ball. */
  seeds: Correction[] = [];

  private constructor(tracker: VideoTracker, known: Known) {
    this.#tracker = tracker;
    this.#known = known;
  }

  /** Gives all frames of a source; `shown` sees each. */
  static async through(source: Source, known: Known, { model, device }: { model: string | Model; device: DeviceChoice }, { signal, progress }: Watch, shown: (frame: Frame) => void): Promise<Tracking> {
    const tracker = await VideoTracker.create({ threads: "auto", ...(known.camera && { camera: known.camera }), ...(known.court && { court: known.court }), model, device, signal, onProgress: ({ stage, loaded, total }) => stage === "weights" && progress(loaded, total) });
    const tracking = new Tracking(tracker, known);
    signal.addEventListener("abort", () => tracker.dispose(), { once: true });
    try {
      progress(0, source.durationMs, "Watching the video…");
      const add = async (picture: Picture, timeMs: number) => {
        signal.throwIfAborted();
        const [first = timeMs] = tracking.#times;
        // From the first frame on, as the command counts: a file's own clock need not start at 0.
        await tracker.add(picture, timeMs - first);
        tracking.#times.push(timeMs);
        progress(timeMs, source.durationMs);
      };
      // Loaded only here: it is five times as large as the rest of the step.
      const decoded = source instanceof VideoSource && source.file ? await (await import("../shared/decoded")).DecodedVideo.open(source.file) : undefined;
      try {
        if (decoded || source instanceof PictureSource) {
          for await (const frame of decoded?.frames() ?? (source as PictureSource).frames) {
            shown(frame);
            await add(frame.picture, frame.timeMs);
          }
        } else tracking.missed = await played(source, add, signal, shown);
        if (decoded) tracking.broken = decoded.broken;
      } finally {
        decoded?.close();
      }
      return tracking;
    } catch (thrown) {
      tracker.dispose();
      throw thrown;
    }
  }

  /** Takes another place, or another uncertainty of the same camera. */
  use(known: Known): void {
    this.#known = known;
  }

  /** Frames that were given. */
  get watched(): number {
    return this.#times.length;
  }

  /** The ball in all frames. */
  async track({ signal, progress }: Watch): Promise<TrackResult> {
    progress(0, null, "Finding the flights…");
    const { camera, cameraSigma, cameraAssumed, scene } = this.#known;
    const tracked = await this.#tracker.track({
      ...(camera && scene && { camera, cameraSigma, cameraAssumed, scene }),
      seeds: this.seeds,
      timesKnown: true,
      signal,
      onProgress: ({ loaded, total }) => progress(loaded, total),
    });
    const { missed, broken } = this;
    return new TrackResult({ tracked, timesMs: this.#times, camera: scene && camera, missed, broken });
  }

  dispose(): void {
    this.#tracker.dispose();
  }
}

/** Plays a video from its start to its end, as slowly as the tracker is; returns how many frames were missed. */
async function played(source: Source, add: (picture: Picture, timeMs: number) => Promise<void>, signal: AbortSignal, shown: (frame: Frame) => void): Promise<number> {
  const { onFrame, onState } = source;
  const video = source.element;
  if (!video) throw new Error("The source is not a video.");
  const before = video.playbackRate;
  let rate = FIRST_RATE;
  let last = -Infinity;
  let waiting = 0;
  let missed = 0;
  // Seconds that the tracker takes for a frame, lately, and between two frames.
  let taken = 0;
  let between = Infinity;
  let chain = Promise.resolve();
  // When the video's clock moved last, and where it was.
  let latest = performance.now();
  let clock = -1;
  let watch = 0;
  try {
    await new Promise<void>((resolve, reject) => {
      watch = window.setInterval(() => {
        if (waiting > 0 || video.currentTime !== clock) [latest, clock] = [performance.now(), video.currentTime];
        else if (performance.now() - latest > LONGEST_STANDSTILL) resolve();
      }, 500);
      const fail = (thrown: unknown) => reject(thrown instanceof Error ? thrown : new Error(String(thrown)));
      signal.addEventListener("abort", () => fail(signal.reason), { once: true });
      source.onFrame = (frame, more) => {
        if (frame.timeMs <= last) return;
        if (more && Number.isFinite(last)) {
          missed += more;
          rate *= SLOWER;
        } else between = Math.min(between, (frame.timeMs - last) / 1000);
        last = frame.timeMs;
        const fit = taken ? Math.min(rate, (BUSY * between) / taken) : rate;
        source.setRate(Math.min(1, Math.max(SLOWEST, fit)));
        shown(frame);
        waiting++;
        if (waiting > MOST_WAITING) source.pause();
        const bitmap = createImageBitmap(video, { colorSpaceConversion: "none" });
        bitmap.catch(() => {});
        const { timeMs } = frame;
        chain = chain.then(async () => {
          const picture = await bitmap;
          const start = performance.now();
          await add(picture, timeMs);
          const seconds = (performance.now() - start) / 1000;
          taken = taken ? 0.8 * taken + 0.2 * seconds : seconds;
          // It may be faster than was thought.
          rate = Math.min(1, 1.02 * rate);
          picture.close();
          waiting--;
          if (video.ended) {
            if (waiting === 0) resolve();
          } else if (waiting <= FEW_WAITING && !source.playing) await source.play();
        });
        chain.catch(fail);
      };
      source.onState = () => {
        if (video.ended && waiting === 0) resolve();
      };
      source.setRate(rate);
      source.seek(0);
      source.play().catch(fail);
    });
  } finally {
    clearInterval(watch);
    source.pause();
    source.setRate(before);
    [source.onFrame, source.onState] = [onFrame, onState];
    source.onState();
  }
  return missed;
}
