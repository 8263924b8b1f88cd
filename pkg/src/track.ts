import { GravisightError } from "./error.js";
import { makeDisposable } from "./connect.js";
import { Toolbox } from "./toolbox.js";
import type { Camera, CoreOptions, Parameter, Scene, Trajectory } from "./types.js";

/** Options of {@link Track.create}. */
export interface TrackOptions extends CoreOptions {
  camera: Camera;
  scene: Scene;
  /** `oneSigma` of the calibration that made the camera: its uncertainty enters σ. */
  cameraSigma?: Camera[];
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
  timestampMs: number;
  /** Pixels; null where the ball was not seen. */
  image: [number, number] | null;
  confidence?: number;
  /** Apparent radius, pixels: one that is known makes the distance surer. */
  radiusPx?: number;
  /** Its standard deviation, pixels. Default: the larger of 5 % and 0.3 px. */
  radiusSigmaPx?: number;
}

/** A {@link Sighting} as the core takes it. */
interface Seen {
  timestampMs: number;
  image: [number, number] | null;
  radius: [number, number] | null;
}

/**
 * The trajectory behind sightings in a video: positions smoothed by the laws of motion, velocities, bounces. Depth comes
 * from the way that gravity bends the track, not from the single pictures, so it is far surer than theirs.
 */
export class Track {
  readonly #toolbox: Toolbox;
  readonly #owned: boolean;
  readonly #options: TrackOptions;
  #sightings: Seen[] = [];

  private constructor(toolbox: Toolbox, options: TrackOptions) {
    this.#toolbox = toolbox;
    this.#owned = options.toolbox === undefined;
    this.#options = options;
  }

  static async create(options: TrackOptions): Promise<Track> {
    return new Track(options.toolbox ?? (await Toolbox.create(options)), options);
  }

  /** Sightings so far. */
  get length(): number {
    return this.#sightings.length;
  }

  /** Adds a sighting. @throws {@link GravisightError} `timestamp-order` where it is not later than the last one. */
  add({ timestampMs, image, confidence, radiusPx, radiusSigmaPx }: Sighting): void {
    const last = this.#sightings.at(-1);
    if (!Number.isFinite(timestampMs) || (last && !(timestampMs > last.timestampMs))) {
      const before = last ? `, the last one's was ${last.timestampMs} ms` : "";
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${before}.`);
    }
    const seen = confidence === undefined || confidence >= (this.#options.leastConfidence ?? 0.5);
    this.#sightings.push({
      timestampMs,
      image: seen && image ? [image[0], image[1]] : null,
      radius: seen && image && radiusPx ? [radiusPx, radiusSigmaPx ?? Math.max(0.05 * radiusPx, 0.3)] : null,
    });
    const { window } = this.#options;
    if (window !== undefined && this.#sightings.length > window) this.#sightings.shift();
  }

  /** Forgets all sightings. */
  clear(): void {
    this.#sightings = [];
  }

  /**
   * The trajectory through the sightings. Look at `explained` before you trust it.
   *
   * @throws {@link GravisightError} `fit` for too few sightings, or a track that nothing explains.
   */
  async fit(options: { signal?: AbortSignal } = {}): Promise<Trajectory> {
    const { camera, scene, noisePx, estimate, cameraSigma } = this.#options;
    const start = this.#sightings[0]?.timestampMs ?? 0;
    const frames = this.#sightings.map(({ timestampMs, image, radius }) => ({ t: (timestampMs - start) / 1000, image, radius }));
    const { signal } = options;
    const fit = await this.#toolbox.fitTrack(frames, {
      camera,
      scene,
      ...(noisePx !== undefined && { noisePx }),
      ...(estimate && { estimate }),
      ...(cameraSigma && { cameraSigma }),
      ...(signal && { signal }),
    });
    const at = (t: number) => start + 1000 * t;
    const { frames: fitted, impacts, flights, hits, ...all } = fit;
    return {
      ...all,
      points: fitted.map(({ t, ...point }) => ({ timestampMs: at(t), ...point })),
      flights: flights.map(({ start: from, end, ...flight }) => ({ startMs: at(from), endMs: at(end), ...flight })),
      hits: hits.map(({ time, ...hit }) => ({ timestampMs: at(time), ...hit })),
      bounces: impacts.map(({ t, ...bounce }) => ({ timestampMs: at(t), ...bounce })),
    };
  }

  /** Frees the memory, unless the toolbox is the caller's. Harmless twice. */
  dispose(): void {
    if (this.#owned) this.#toolbox.dispose();
  }
}
makeDisposable(Track);
