import { Channel } from "./channel.js";
import { GravisightError, wordsOf } from "./error.js";
import { pictureToSend } from "./picture.js";
import type { RawOptions } from "./raw.js";
import type {
  Camera,
  CreateOptions,
  Device,
  DeviceChoice,
  DrawablePicture,
  FrameLocalisation,
  Localisation,
  LocaliseOptions,
  Picture,
} from "./types.js";

const DEVICES: readonly DeviceChoice[] = ["cpu", "webgpu", "auto"];

/** Finds a ball's position in space in single pictures. All work is done in a Worker of its own. */
export class Localiser {
  /** The device that was taken, and why. */
  readonly device: Device;
  readonly #channel: Channel;
  #lastTimestampMs = -Infinity;

  private constructor(channel: Channel, device: Device) {
    this.#channel = channel;
    this.device = device;
  }

  /**
   * Fetches the core and the weights, checks and warms them up.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted, which also ends the Worker.
   */
  static async create(options: CreateOptions): Promise<Localiser> {
    const { device = "cpu", signal, onProgress } = options;
    signal?.throwIfAborted();
    if (!DEVICES.includes(device)) {
      throw new GravisightError("device", `"${device}" is no device; choose ${DEVICES.join(", ")}.`);
    }
    const model = absoluteUrl(options.model);
    const channel = new Channel();
    try {
      const taken = await channel.request("create", { model, device }, { signal, onProgress });
      return new Localiser(channel, taken);
    } catch (thrown) {
      channel.close(disposed());
      throw thrown;
    }
  }

  /**
   * Finds the ball in a picture. Calls are served one after the other.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  async localise(image: Picture, options: LocaliseOptions): Promise<Localisation> {
    const { signal } = options;
    signal?.throwIfAborted();
    this.#channel.throwIfClosed();
    const camera = jsonOf(options.camera);
    const { picture, transfer } = await pictureToSend(image);
    const raw: RawOptions = { maps: options.maps ?? false };
    // A copy: what a framework wraps in a Proxy cannot be sent.
    if (options.truth) raw.truth = [...options.truth];
    const answer = await this.#channel.request("localise", { picture, camera, options: raw }, { transfer, signal });
    return { ...answer, device: this.device };
  }

  /**
   * Finds the ball in the current frame of a video.
   *
   * @param timestampMs must increase from call to call (else `timestamp-order`).
   */
  async localiseVideoFrame(
    video: HTMLVideoElement | DrawablePicture,
    timestampMs: number,
    options: LocaliseOptions,
  ): Promise<FrameLocalisation> {
    if (!(timestampMs > this.#lastTimestampMs)) {
      const last = Number.isFinite(this.#lastTimestampMs) ? `, the last frame's was ${this.#lastTimestampMs} ms` : "";
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${last}.`);
    }
    this.#lastTimestampMs = timestampMs;
    return { ...(await this.localise(video, options)), timestampMs };
  }

  /** Ends the Worker, and with it all memory of the model; later calls reject with code `disposed`. */
  dispose(): void {
    this.#channel.close(disposed());
  }
}

function disposed(): GravisightError {
  return new GravisightError("disposed", "This Localiser was disposed of. Create a new one.");
}

function absoluteUrl(model: string | URL): string {
  try {
    // There is no document where the caller is a Worker itself.
    return new URL(model, globalThis.document?.baseURI ?? globalThis.location.href).href;
  } catch {
    throw new GravisightError("model-url", `"${String(model)}" is not a URL.`);
  }
}

/** JSON would silently turn NaN and infinity into null. */
function jsonOf(camera: Camera): string {
  const finite = (key: string, value: unknown) => {
    if (typeof value === "number" && !Number.isFinite(value)) {
      throw new GravisightError("camera-not-finite", `The camera holds ${value} at "${key}"; every number must be finite.`);
    }
    return value;
  };
  let json: string | undefined;
  try {
    json = JSON.stringify(camera, finite);
  } catch (thrown) {
    if (thrown instanceof GravisightError) throw thrown;
    throw new GravisightError("camera-format", `The camera cannot be written as JSON: ${wordsOf(thrown)}.`, { cause: thrown });
  }
  if (json === undefined) throw new GravisightError("camera-format", `The camera is ${typeof camera}, not a camera.json object.`);
  return json;
}
