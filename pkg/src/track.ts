import { GravisightError } from "./error.js";
import { makeDisposable, whole } from "./connect.js";
import { Toolbox } from "./toolbox.js";
import type { Camera, CoreOptions, Fit, FitTrackOptions, Observation, Parameter, Scene } from "./types.js";

/** Options of {@link Track.create}. */
export interface TrackOptions extends CoreOptions {
  /** The camera that saw the ball; it stands still. */
  camera: Camera;
  /** Gravity, the ball, and what it can touch. */
  scene: Scene;
  /** `oneSigma` of the calibration that made the camera: its uncertainty enters σ. */
  cameraSigma?: Camera[];
  /** Whether the camera is assumed ({@link Toolbox.assumedCamera}): its uncertainty then enters σ and rejects no flight. Default: false. */
  cameraAssumed?: boolean;
  /** Found with less confidence than this, a position counts as not seen. Default: 0.5. */
  leastConfidence?: number;
  /** Standard deviation of the 2D positions, pixels; found from them where missing. */
  noisePx?: number;
  /** What to estimate besides the trajectory. */
  estimate?: Parameter[];
  /** Keeps only so many of the last points. Default: all. */
  window?: number;
  /** A toolbox to use; without, the track has one of its own. */
  toolbox?: Toolbox;
}

/** One sighting: what {@link Localiser.localiseVideoFrame} returns, or a 2D label. */
export interface Sighting {
  /** When the frame was taken, milliseconds from any start. */
  timestampMs: number;
  /** The ball's centre, pixels; null where the ball was not seen. */
  image: [number, number] | null;
  /** How sure it is that this is the ball, 0 to 1. Default: it is. */
  confidence?: number;
  /** Apparent radius, pixels: one that is known makes the distance surer. */
  radiusPx?: number;
  /** Its standard deviation, pixels. Default: the larger of 5 % and 0.3 px. */
  radiusSigmaPx?: number;
}

/**
 * The trajectory behind sightings in a video: positions smoothed by the laws of motion, velocities, bounces. Depth comes
 * from the way that gravity bends the track, not from the single pictures, so it is far surer than theirs.
 */
export class Track {
  readonly #toolbox: Toolbox;
  readonly #owned: boolean;
  readonly #options: TrackOptions;
  #sightings: Observation[] = [];

  private constructor(toolbox: Toolbox, options: TrackOptions) {
    this.#toolbox = toolbox;
    this.#owned = options.toolbox === undefined;
    this.#options = options;
  }

  /** Loads the core, or takes the toolbox that is given. @throws {@link GravisightError} where the core cannot be had. */
  static async create(options: TrackOptions): Promise<Track> {
    return new Track(options.toolbox ?? (await Toolbox.create(options)), options);
  }

  /** Sightings so far. */
  get length(): number {
    return this.#sightings.length;
  }

  /** Adds a sighting. @throws {@link GravisightError} `timestamp-order` where it is not later than the last one. */
  add({ timestampMs, image, confidence, radiusPx, radiusSigmaPx }: Sighting): void {
    const time = timestampMs / 1000;
    const last = this.#sightings.at(-1);
    if (!Number.isFinite(time) || (last && !(time > last.time))) {
      const before = last ? `, the last one's was ${1000 * last.time} ms` : "";
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${before}.`);
    }
    const seen = image && (confidence === undefined || confidence >= (this.#options.leastConfidence ?? 0.5));
    const radius: Observation["radius"] = seen && radiusPx ? [radiusPx, radiusSigmaPx ?? Math.max(0.05 * radiusPx, 0.3)] : undefined;
    this.#sightings.push(whole<Observation>({ time, image: seen ? [image[0], image[1]] : null, radius }));
    const { window } = this.#options;
    if (window !== undefined && this.#sightings.length > window) this.#sightings.shift();
  }

  /** Forgets all sightings. */
  clear(): void {
    this.#sightings = [];
  }

  /**
   * The trajectory through the sightings; its times are those of the timestamps, in seconds. Look at `explained` before you trust it.
   *
   * @throws {@link GravisightError} `fit` for too few sightings, or a track that nothing explains.
   */
  fit({ signal }: { signal?: AbortSignal } = {}): Promise<Fit> {
    const { camera, scene, noisePx, estimate, cameraSigma, cameraAssumed } = this.#options;
    return this.#toolbox.fitTrack(this.#sightings, whole<FitTrackOptions>({ camera, scene, noisePx, estimate, cameraSigma, cameraAssumed, signal }));
  }

  /** Frees the memory, unless the toolbox is the caller's. Harmless twice. */
  dispose(): void {
    if (this.#owned) this.#toolbox.dispose();
  }
}
makeDisposable(Track);
