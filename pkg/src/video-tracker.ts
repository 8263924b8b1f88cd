import { sourceOf } from "./builds.js";
import type { Known } from "../wasm/cpu/gravisight.js";
import { connect, disposed, jsonOf, makeDisposable, whole } from "./connect.js";
import { GravisightError } from "./error.js";
import { checkedDevice, modelOf } from "./localiser.js";
import { pictureToSend, release, type PictureToSend } from "./picture.js";
import type { Transport } from "./protocol.js";
import type { Ball, Camera, DrawablePicture, ModelOptions, Picture, Progress, Scene, TrackedVideo, TrackerConfig } from "./types.js";

/** Options of {@link VideoTracker.create}. */
export interface VideoTrackerOptions extends ModelOptions {
  /**
   * The camera, which stays where it is, and may turn and zoom. Without it and a scene only the 2D track comes out. Given here rather than to
   * {@link VideoTracker.track}, it also tells how balls away from the middle of a wide picture are drawn out.
   */
  camera?: Camera;
  /** The place and its ball: an object, or the name of a sport ({@link Toolbox.scenes}). */
  scene?: Scene | string;
  /** The ball in place of the scene's. */
  ball?: Ball;
  /**
   * The court that the video shows ({@link Toolbox.courts}): its painted lines tell how the camera turns and zooms. Default: that of the sport that
   * `scene` names, if its lines are known. Without a camera nothing follows from it.
   */
  court?: string;
  /** Numbers of the tracker that are not the usual ones: parts of the `config` of a result, or of what `gravisight track --json` prints. */
  config?: TrackerConfig;
}

type SceneSetup = Pick<VideoTrackerOptions, "camera" | "scene" | "ball">;

/** Where a person saw the ball. */
export interface Seed {
  /** The frame's number, from 0. */
  frame: number;
  /** The ball's centre, pixels. */
  image: [number, number];
}

/** Options of {@link VideoTracker.track}. */
export interface TrackVideoOptions extends SceneSetup {
  /** Places in which a person saw the ball. What flies through them is the ball. Of several in one frame the last counts. */
  seeds?: Seed[];
  /** `oneSigma` of the calibration that made the camera: its uncertainty enters σ. */
  cameraSigma?: Camera[];
  /**
   * Whether the camera is assumed ({@link Toolbox.assumedCamera}). Its uncertainty then enters σ and rejects no flight; otherwise a flight
   * whose distance the camera leaves open is not explained. Default: false.
   */
  cameraAssumed?: boolean;
  /** Most hits of a racket, a foot or a hand between two pauses. Default: as many as the track needs. */
  hits?: number;
  /** Whether every frame of the video was given, with its own time. Default: false. */
  timesKnown?: boolean;
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
  /** Hears how many parts of the video are fitted. */
  onProgress?: (progress: Progress) => void;
}

/** Follows a ball through a video of a camera that stays where it is, and may turn and zoom: its flights, bounces and hits in metres. */
export class VideoTracker {
  readonly #transport: Transport;
  readonly #setup: SceneSetup;
  readonly #config: string | undefined;
  readonly #court: string | undefined;
  #last = -Infinity;
  /** Of the last frame's pixels, which the engine has read; of one frame at a time. */
  #memory: Uint8Array<ArrayBuffer> | undefined;
  /** Settles when the frames so far were added. */
  #added: Promise<unknown> = Promise.resolve();

  private constructor(transport: Transport, setup: SceneSetup, config: string | undefined, court: string | undefined) {
    this.#transport = transport;
    this.#setup = setup;
    this.#config = config;
    this.#court = court;
  }

  /**
   * Fetches the core and the model.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  static async create(options: VideoTrackerOptions = {}): Promise<VideoTracker> {
    const { signal, onProgress, cache = true, camera, scene, ball } = options;
    signal?.throwIfAborted();
    const config = options.config && jsonOf(options.config, "config");
    const request = { model: modelOf(options.model), device: checkedDevice(options.device), ...sourceOf(options), cache };
    const transport = connect(options);
    try {
      await transport.call("create", request, { signal, onProgress });
      return new VideoTracker(transport, whole<SceneSetup>({ camera, scene, ball }), config, options.court);
    } catch (thrown) {
      transport.close(disposed("VideoTracker"));
      throw thrown;
    }
  }

  /**
   * Gives the next frame. Frames are held by the core only until it has looked at them. Calls need not be awaited: they are served one
   * after the other, each with its picture as it was.
   *
   * @param timestampMs must increase from call to call (else `timestamp-order`, and nothing else happens). That of a call that fails does
   * not count.
   * @throws {@link GravisightError} `data` for a frame of another size than the first; `camera-mismatch` for one that the
   * camera's shape is not.
   */
  async add(frame: Picture | DrawablePicture, timestampMs: number): Promise<void> {
    this.#transport.throwIfClosed();
    const memory = this.#memory;
    this.#memory = undefined;
    const copied = pictureToSend(frame, memory);
    // It is awaited only after the frames before it.
    copied.catch(() => {});
    const added = this.#added.then(() => this.#add(copied, timestampMs));
    // A bitmap of a frame that was never sent is this method's to free.
    added.catch(() => copied.then(release, () => {}));
    this.#added = added.catch(() => {});
    return added;
  }

  async #add(copied: Promise<PictureToSend>, timestampMs: number): Promise<void> {
    if (!Number.isFinite(timestampMs) || timestampMs <= this.#last) {
      const last = Number.isFinite(this.#last) ? `, the last frame's was ${this.#last} ms` : "";
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${last}.`);
    }
    const { picture, transfer } = await copied;
    const { camera, scene } = this.#setup;
    const sport = typeof scene === "string" ? scene : undefined;
    const request = { picture, time: timestampMs / 1000, camera: camera && jsonOf(camera, "camera"), config: this.#config, court: this.#court, sport };
    this.#memory = (await this.#transport.call("addFrame", request, { transfer })) ?? undefined;
    this.#last = timestampMs;
  }

  /**
   * The ball in all frames that were given; no more can be added. Times are those of the timestamps, in seconds. May be called again: with
   * seeds, with another place. Look at `explained` before you trust what is in metres.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  async track(options: TrackVideoOptions = {}): Promise<TrackedVideo> {
    this.#transport.throwIfClosed();
    await this.#added;
    const { signal, onProgress, hits, seeds = [], timesKnown = false, cameraSigma = [], cameraAssumed = false } = options;
    const { scene = this.#setup.scene, ball = this.#setup.ball } = options;
    // A camera that only the tracker was made with, without a scene, tells how balls look, and makes no metres.
    const camera = options.camera ?? (scene ? this.#setup.camera : undefined);
    if (!camera !== !scene) {
      throw new GravisightError(camera ? "scene-missing" : "camera-missing", `Positions in metres need a camera and a scene, but there is no ${camera ? "scene" : "camera"}.`);
    }
    const resolved = typeof scene === "string" ? await this.#transport.call("scene", { name: scene }) : scene;
    const known = whole<Known>({
      camera,
      scene: resolved && ball ? await this.#transport.call("sceneWithBall", { scene: jsonOf(resolved, "scene"), radius: ball.radius }) : resolved,
      hits,
      cameraSigma,
      cameraAssumed,
      seeds: seeds.map(({ frame, image }) => [frame, image]),
      timesKnown,
    });
    return this.#transport.call("trackVideo", { known: jsonOf(known, "options"), config: this.#config }, { signal, onProgress });
  }

  /** Frees its memory and ends its Worker; one that you gave goes on. Harmless twice. */
  dispose(): void {
    this.#transport.close(disposed("VideoTracker"));
  }
}
makeDisposable(VideoTracker);
