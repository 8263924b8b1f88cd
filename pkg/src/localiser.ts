import type { Region, Scene, Wanted } from "../wasm/cpu/gravisight.js";
import { sourceOf } from "./builds.js";
import { connect, disposed, jsonOf, makeDisposable, whole } from "./connect.js";
import { GravisightError } from "./error.js";
import { pictureToSend } from "./picture.js";
import type { Transport } from "./protocol.js";
import type {
  Ball,
  Camera,
  Card,
  CreateOptions,
  Device,
  DeviceChoice,
  DrawablePicture,
  FrameLocalisation,
  Localisation,
  LocaliseOptions,
  Model,
  Picture,
} from "./types.js";
import { absoluteUrl } from "./url.js";

const DEVICES: readonly DeviceChoice[] = ["cpu", "webgpu", "auto"];

/** Finds a ball's position in space in single pictures. */
export class Localiser {
  /** The model's card: its name, what it was trained on, how good it is. */
  readonly card: Card;
  #device: Device;
  #camera: string | undefined;
  #ball: Ball | undefined;
  readonly #transport: Transport;
  /** Of the frames that were given and have not failed, rising. */
  #timestampsMs: number[] = [];

  private constructor(transport: Transport, card: Card, device: Device, camera: string | undefined, ball: Ball | undefined) {
    this.#transport = transport;
    this.#ball = ball;
    this.card = card;
    this.#device = device;
    this.#camera = camera;
  }

  /** The device that was taken, and why. It changes where WebGPU fails while in use: then the CPU goes on. */
  get device(): Device {
    return this.#device;
  }

  /**
   * Fetches the core and the weights, checks and warms them up.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted, which also ends a Worker of its own.
   */
  static async create(options: CreateOptions): Promise<Localiser> {
    const { signal, onProgress, cache = true } = options;
    signal?.throwIfAborted();
    const device = checkedDevice(options.device);
    const model = modelOf(options.model);
    const source = sourceOf(options);
    const camera = options.camera === undefined ? undefined : jsonOf(options.camera, "camera");
    const ball = options.ball && ballOf(options.ball);
    const transport = connect(options);
    try {
      const taken = await transport.call("create", { model, device, ...source, cache }, { signal, onProgress });
      return new Localiser(transport, taken.card, taken.device, camera, ball);
    } catch (thrown) {
      transport.close(disposed("Localiser"));
      throw thrown;
    }
  }

  /** The camera that takes the pictures from now on. */
  setCamera(camera: Camera): void {
    this.#transport.throwIfClosed();
    this.#camera = jsonOf(camera, "camera");
  }

  /** The ball that is looked for from now on. */
  setBall(ball: Ball): void {
    this.#transport.throwIfClosed();
    this.#ball = ballOf(ball);
  }

  /**
   * Finds the ball in a picture. Calls are served one after the other.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  async localise(image: Picture, options: LocaliseOptions = {}): Promise<Localisation> {
    const { signal, saliency } = options;
    signal?.throwIfAborted();
    this.#transport.throwIfClosed();
    const camera = cameraOf(options.camera, this.#camera);
    const coreOptions = coreOptionsOf(options, this.#ball);
    const { picture, transfer } = await pictureToSend(image);
    // Its buffer is gone once it is sent.
    const again = saliency ? await pictureToSend(image) : undefined;
    const found: Localisation = await this.#transport.call("localise", { picture, camera, options: coreOptions }, { transfer, signal });
    this.#device = found.device;
    if (again) {
      found.saliency = await this.#transport.call("saliency", { picture: again.picture }, { transfer: again.transfer, signal });
      // Of a model that reads sizes these are fractions of the depth.
      if (this.card.depth_from === "size") found.saliency.values = found.saliency.values.map((fraction) => fraction * found.depth);
    }
    return found;
  }

  /**
   * Finds the ball in the current frame of a video.
   *
   * @param timestampMs must increase from call to call, or from {@link startVideo} on (else `timestamp-order`, and nothing else happens). That of
   * a call that fails does not count.
   */
  async localiseVideoFrame(frame: DrawablePicture | Picture, timestampMs: number, options: LocaliseOptions = {}): Promise<FrameLocalisation> {
    const given = this.#timestampsMs;
    const last = given.at(-1);
    if (!(timestampMs > (last ?? -Infinity))) {
      const before = last === undefined ? "" : `, the last frame's was ${last} ms`;
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${before}.`);
    }
    given.push(timestampMs);
    try {
      const found = await this.localise(frame, options);
      // Those before it no longer matter.
      given.splice(0, given.indexOf(timestampMs));
      return { ...found, timestampMs };
    } catch (thrown) {
      const at = given.indexOf(timestampMs);
      if (at >= 0) given.splice(at, 1);
      throw thrown;
    }
  }

  /** The next frame may have any timestamp: for another video, or for the same one from another place. */
  startVideo(): void {
    this.#timestampsMs = [];
  }

  /**
   * Frees all memory of the model and ends its Worker; one that you gave goes on. What is under way and later calls reject with code
   * `disposed`. Harmless twice.
   */
  dispose(): void {
    this.#transport.close(disposed("Localiser"));
  }
}
makeDisposable(Localiser);

/** A model's full URL, or a copy of one in memory; undefined for the package's own. */
export function modelOf(model: string | URL | Model | undefined): string | Model | undefined {
  if (model === undefined) return undefined;
  if (typeof model === "string" || model instanceof URL) return absoluteUrl(model);
  const { card, weights } = Object(model) as Partial<Record<keyof Model, unknown>>;
  if (typeof card !== "string") {
    throw new GravisightError("model-format", `A model in memory needs its card in \`card\`, as the text of its JSON file, not ${typeof card}.`);
  }
  if (!(weights instanceof Uint8Array) && !(weights instanceof ArrayBuffer)) {
    const found = weights === null ? "null" : typeof weights;
    throw new GravisightError("model-format", `A model in memory needs the bytes of its .safetensors file in \`weights\`, as a Uint8Array, not ${found}.`);
  }
  return { card, weights: new Uint8Array(weights) };
}

export function checkedDevice(device: DeviceChoice = "cpu"): DeviceChoice {
  if (DEVICES.includes(device)) return device;
  throw new GravisightError("device", `"${device}" is not a device; choose one of ${DEVICES.join(", ")}.`);
}

/** The camera of a call, as JSON. */
export function cameraOf(given: Camera | undefined, own?: string): string {
  const camera = given === undefined ? own : jsonOf(given, "camera");
  if (camera !== undefined) return camera;
  throw new GravisightError("camera-missing", "No camera: give one to `create` or `setCamera`, or with the picture.");
}

/** A copy: what a framework wraps in a Proxy cannot be sent. */
export function ballOf({ radius }: Ball): Ball {
  return whole<Ball>({ radius });
}

/** The core's options for a picture. */
export function coreOptionsOf(options: LocaliseOptions, own?: Ball): Wanted {
  const { heatmap = false, depthMap = false, truth, region, scene, candidates = 0, cameraSigma = [], ball = own } = options;
  // Copies: what a framework wraps in a Proxy cannot be sent.
  return whole<Wanted>({
    heatmap,
    depthMap,
    candidates,
    cameraSigma: JSON.parse(jsonOf(cameraSigma, "cameraSigma")) as Camera[],
    // What is no scene is for the core to refuse.
    ballRadius: ball?.radius ?? (scene as Partial<Scene> | undefined)?.ball?.radius,
    region: region && whole<Region>({ left: region.left, top: region.top, width: region.width, height: region.height }),
    scene: scene && (JSON.parse(jsonOf(scene, "scene")) as Scene),
    truth: truth && [...truth],
  });
}
