import { sourceOf } from "./builds.js";
import { connect, disposed, jsonOf, makeDisposable, whole } from "./connect.js";
import { pictureToSend } from "./picture.js";
import type { Answer, CallName, Request, Transport } from "./protocol.js";
import type {
  AssumedCamera,
  Ball,
  BallAt,
  BallAtOptions,
  CalibrateOptions,
  Calibration,
  CalibrationPoints,
  Camera,
  CameraToAssume,
  CoreOptions,
  Court,
  CourtSearch,
  DrawnCircle,
  FindCourtOptions,
  Fit,
  FitTrackOptions,
  Forecast,
  Observation,
  Picture,
  Pixels,
  Scene,
  SimulatedClip,
  SimulatorOptions,
  Vector,
} from "./types.js";

/** What needs no model: calibration, physics, labels, synthetic scenes. */
export class Toolbox {
  readonly #transport: Transport;

  private constructor(transport: Transport) {
    this.#transport = transport;
  }

  /** Fetches the core. @throws {@link GravisightError}; or the reason of `signal` where it is aborted. */
  static async create(options: CoreOptions = {}): Promise<Toolbox> {
    const { signal, onProgress } = options;
    signal?.throwIfAborted();
    const source = sourceOf(options);
    const transport = connect(options);
    try {
      await transport.call("open", source, { signal, onProgress });
      return new Toolbox(transport);
    } catch (thrown) {
      transport.close(disposed("Toolbox"));
      throw thrown;
    }
  }

  /**
   * A camera from labelled points: at least six, or four in one plane. With a `picture`, the court's painted lines (or `points.lines`) pull it
   * to a fraction of a pixel; fails where too few are found.
   */
  async calibrate(points: CalibrationPoints, options: CalibrateOptions = {}): Promise<Calibration> {
    const sent = options.picture && (await pictureToSend(options.picture));
    const request = () => ({ points: jsonOf(points, "points"), estimate: [...(options.estimate ?? [])], picture: sent?.picture });
    return this.#call("calibrate", request, options.signal, sent?.transfer);
  }

  /**
   * Finds a court's camera by its painted lines, without clicks. `court` is the sport played there ({@link Toolbox.courts}), or `"auto"` for any.
   * A picture without the court is no error: `found.verdict` is `"none"`. At `"probable"`, let a person check the lines.
   */
  async findCourt(picture: Picture, court: string, options: FindCourtOptions = {}): Promise<CourtSearch> {
    const sent = await pictureToSend(picture);
    const request = () => ({ picture: sent.picture, court, estimate: [...(options.estimate ?? [])] });
    return this.#call("findCourt", request, options.signal, sent.transfer);
  }

  /** Names of the courts whose points are known. */
  courts(): Promise<string[]> {
    return this.#call("courts", () => ({}));
  }

  /** A court's named points. */
  court(name: string): Promise<Court> {
    return this.#call("court", () => ({ name }));
  }

  /** Names of the scenes of common sports, `floor` (nothing but a level one) and `free` (nothing to touch). */
  scenes(): Promise<string[]> {
    return this.#call("scenes", () => ({}));
  }

  /** The scene of a common sport: its ball, surfaces, lines and net. */
  scene(name: string): Promise<Scene> {
    return this.#call("scene", () => ({ name }));
  }

  /**
   * The scene with a ball of another radius, m. What that ball weighs is not known: its mass follows its cross-section, so that the air slows it as much.
   *
   * @throws {@link GravisightError} `value` for a radius that no ball has.
   */
  sceneWithBall(scene: Scene, ball: Ball): Promise<Scene> {
    return this.#call("sceneWithBall", () => ({ scene: jsonOf(scene, "scene"), radius: ball.radius }));
  }

  /** Where points of the world are in the camera's picture, pixels; null for what it cannot see. */
  async project(camera: Camera, points: Vector[]): Promise<([number, number] | null)[]> {
    const flat = await this.#call("project", () => ({ camera: jsonOf(camera, "camera"), points: points.flat() }));
    return points.map((_, index) => {
      const [x = NaN, y = NaN] = flat.slice(2 * index, 2 * index + 2);
      return Number.isNaN(x) ? null : [x, y];
    });
  }

  /**
   * Where the ball is that somebody drew a circle around, without a network. The uncertainty is that of the circle (`sigmaPx`) and of the
   * camera (`cameraSigma`). A ball is an ellipse in the picture; the circle stands for one of its area.
   *
   * @throws {@link GravisightError} `no-ball` where no ball has this circle; `value` for a circle or a radius that is none.
   */
  ballAt(camera: Camera, circle: DrawnCircle, ball: Ball, options: BallAtOptions = {}): Promise<BallAt> {
    const { centre, radiusPx, sigmaPx, picture } = circle;
    const request = () => ({
      camera: jsonOf(camera, "camera"),
      // Copies: what a framework wraps in a Proxy cannot be sent.
      circle: whole<DrawnCircle>({
        centre: [...centre],
        radiusPx,
        sigmaPx,
        picture: picture && { width: picture.width, height: picture.height },
      }),
      radius: ball.radius,
      cameraSigma: jsonOf(options.cameraSigma ?? [], "cameraSigma"),
    });
    return this.#call("ballAt", request, options.signal);
  }

  /**
   * A camera for pictures that nobody calibrated: a phone's main camera, held level about 1.5 m above the ground. It lists each assumption
   * with its σ. Pass its `oneSigma` on as `cameraSigma`, so that results state what the assumptions leave open.
   */
  assumedCamera(known: CameraToAssume): Promise<AssumedCamera> {
    const { width, height, focal35mm, heightAboveGround, video } = known;
    return this.#call("assumedCamera", () => ({ known: whole<CameraToAssume>({ width, height, focal35mm, heightAboveGround, video }) }));
  }

  /** The trajectory behind a 2D track; {@link Track} is more convenient. */
  fitTrack(frames: Observation[], options: FitTrackOptions): Promise<Fit> {
    const request = () => ({
      frames: jsonOf(frames, "track"),
      camera: jsonOf(options.camera, "camera"),
      scene: jsonOf(options.scene, "scene"),
      noisePx: options.noisePx,
      estimate: [...(options.estimate ?? [])],
      cameraSigma: jsonOf(options.cameraSigma ?? [], "cameraSigma"),
      cameraAssumed: options.cameraAssumed ?? false,
    });
    return this.#call("fitTrack", request, options.signal);
  }

  /** Where a ball will be at `times` (seconds) that is at `position` with `velocity` at time 0. */
  forecast(scene: Scene, start: { position: Vector; velocity: Vector }, times: number[]): Promise<Forecast> {
    const numbers = [...start.position, ...start.velocity];
    return this.#call("forecast", () => ({ scene: jsonOf(scene, "scene"), start: numbers, times: [...times] }));
  }

  /** One of the paper's synthetic scenes: environment 1 to 3 seen by camera 1 to 9; or the spring. */
  async simulator(options: SimulatorOptions): Promise<Simulator> {
    const environment = options.environment === "spring" ? undefined : options.environment;
    const opened = await this.#call("openScene", () => ({ environment, camera: options.camera ?? 1 }));
    return new Simulator(this.#transport, opened.id, opened.camera, opened.scene);
  }

  /** Frees its memory and ends its Worker; one that you gave goes on. Harmless twice. */
  dispose(): void {
    this.#transport.close(disposed("Toolbox"));
  }

  async #call<K extends CallName>(type: K, request: () => Request<K>, signal?: AbortSignal, transfer: Transferable[] = []): Promise<Answer<K>> {
    this.#transport.throwIfClosed();
    return this.#transport.call(type, request(), { signal, transfer });
  }
}
makeDisposable(Toolbox);

/** What a simulated scene looks like. */
export interface SimulatedPicture extends Pixels {
  /** RGBA, row by row: `new ImageData(data, width, height)` takes it. */
  data: Uint8ClampedArray<ArrayBuffer>;
}

/** A synthetic scene: simulates and draws. Lives as long as its toolbox, or until disposed of. */
export class Simulator {
  /** Its camera. */
  readonly camera: Camera;
  /** The place and its ball. */
  readonly scene: Scene;
  readonly #transport: Transport;
  readonly #id: number;

  /** @internal */
  constructor(transport: Transport, id: number, camera: Camera, scene: Scene) {
    this.#transport = transport;
    this.#id = id;
    this.camera = camera;
    this.scene = scene;
  }

  /** Centres of a ball at `times` (seconds, rising) that starts at `position` (m) with `velocity` (m/s). */
  async path(start: { position: Vector; velocity: Vector }, times: number[]): Promise<Vector[]> {
    const numbers = [...start.position, ...start.velocity];
    const flat = await this.#transport.call("scenePath", { id: this.#id, start: numbers, times: [...times] });
    return times.map((_, index) => [...flat.slice(3 * index, 3 * index + 3)] as Vector);
  }

  /** The picture with the ball at `centre` (m). */
  async picture(centre: Vector): Promise<SimulatedPicture> {
    const rgba = await this.#transport.call("scenePicture", { id: this.#id, centre: [...centre] });
    const data = new Uint8ClampedArray(rgba.buffer as ArrayBuffer, rgba.byteOffset, rgba.length);
    return { data, width: this.camera.width, height: this.camera.height };
  }

  /** A random clip's labels, the same for the same seed and number; its pictures are {@link picture} of `world`. */
  clip(seed: number, number: number): Promise<SimulatedClip> {
    return this.#transport.call("sceneClip", { id: this.#id, seed, number });
  }

  /** Frees its memory. */
  dispose(): void {
    this.#transport.call("closeScene", { id: this.#id }).catch(() => {});
  }
}
makeDisposable(Simulator);
