import { sourceOf } from "./builds.js";
import type { AdaptOptions as Settings } from "../wasm/cpu/gravisight.js";
import { connect, disposed, jsonOf, makeDisposable, whole } from "./connect.js";
import { GravisightError } from "./error.js";
import { checkedDevice, modelOf } from "./localiser.js";
import { pictureToSend } from "./picture.js";
import type { Transport } from "./protocol.js";
import type {
  AdaptBeginOptions,
  AdaptFlights,
  AdaptOptions,
  AdaptProgress,
  AdaptStep,
  AdaptStepOptions,
  AdaptedModel,
  Device,
  DrawablePicture,
  FineTuneResumeOptions,
  Picture,
  TrackedVideo,
} from "./types.js";

/**
 * Adapts a model to one ball, without labels. It trains on the flights that a {@link VideoTracker} found in your videos.
 *
 * For each video: {@link begin}, {@link add} for every frame, {@link end}. Then {@link step} until it returns null, and {@link finish}.
 */
export class Adapter {
  /** The device that was taken, and why. */
  readonly device: Device;
  readonly #transport: Transport;
  #last = -Infinity;

  private constructor(transport: Transport, device: Device) {
    this.#transport = transport;
    this.device = device;
  }

  /**
   * Fetches the core and the model to start from.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  static async create(options: AdaptOptions = {}): Promise<Adapter> {
    const { signal, onProgress, cache = true, steps, learningRate, seed } = options;
    signal?.throwIfAborted();
    const request = { model: modelOf(options.model), device: checkedDevice(options.device), ...sourceOf(options), cache };
    const settings = jsonOf(whole<Partial<Settings>>({ steps, learningRate, seed }), "options");
    const transport = connect(options);
    try {
      return new Adapter(transport, await transport.call("adapter", { ...request, options: settings }, { signal, onProgress }));
    } catch (thrown) {
      transport.close(disposed("Adapter"));
      throw thrown;
    }
  }

  /**
   * Continues from a {@link Adapter.checkpoint}, in another page or after a reload. The checkpoint does not contain the videos: add them again,
   * in the same order, before the next step. On the same device, the result is as if the run had not stopped; on the CPU of the same machine it is
   * bit-identical.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  static async resume(checkpoint: Uint8Array, options: FineTuneResumeOptions = {}): Promise<Adapter> {
    const { signal, onProgress, cache = true } = options;
    signal?.throwIfAborted();
    const request = { checkpoint: new Uint8Array(checkpoint), device: checkedDevice(options.device), ...sourceOf(options), cache };
    const transport = connect(options);
    try {
      const transfer = [request.checkpoint.buffer];
      return new Adapter(transport, await transport.call("resumeAdapter", request, { signal, onProgress, transfer }));
    } catch (thrown) {
      transport.close(disposed("Adapter"));
      throw thrown;
    }
  }

  /**
   * Starts a tracked video; add its frames next. Only flights that physics explains become training data. If the tracker had no camera and scene,
   * runs of frames with a high ball probability do.
   *
   * @returns the numbers of flights and frames that become training data; if 0, you can skip {@link add}.
   * @throws {@link GravisightError} `value` in three cases: `tracked.frames` does not contain all frames of the video, the previous video was not
   * ended, or {@link step} was already called.
   */
  begin(tracked: Pick<TrackedVideo, "explained" | "frames">, options: AdaptBeginOptions = {}): Promise<AdaptFlights> {
    const { seeds = [], camera, ball, signal } = options;
    const { explained, frames } = tracked;
    this.#last = -Infinity;
    const request = {
      tracked: jsonOf({ explained, frames }, "track"),
      seeds: jsonOf(seeds.map(({ frame, image }) => [frame, image]), "options"),
      camera: camera && jsonOf(camera, "camera"),
      radius: ball?.radius,
    };
    return this.#transport.call("adaptBegin", request, { signal });
  }

  /**
   * Adds the next frame of the video. Add all frames that the tracker had, in the same order; await each call before the next.
   *
   * @param timestampMs must increase from call to call (else `timestamp-order`).
   * @throws {@link GravisightError} `value` before {@link begin}.
   */
  async add(frame: Picture | DrawablePicture, timestampMs: number, { signal }: { signal?: AbortSignal } = {}): Promise<void> {
    this.#transport.throwIfClosed();
    if (!Number.isFinite(timestampMs) || timestampMs <= this.#last) {
      const last = Number.isFinite(this.#last) ? `, the last frame's was ${this.#last} ms` : "";
      throw new GravisightError("timestamp-order", `Timestamps must increase: got ${timestampMs} ms${last}.`);
    }
    const { picture, transfer } = await pictureToSend(frame);
    await this.#transport.call("adaptAdd", { picture, time: timestampMs / 1000 }, { transfer, signal });
    this.#last = timestampMs;
  }

  /**
   * Ends the current video. Call it after the last frame.
   *
   * @throws {@link GravisightError} `data` if frames are missing; in that case, nothing from that video is kept.
   */
  async end(options: { signal?: AbortSignal } = {}): Promise<void> {
    await this.#transport.call("adaptEnd", {}, options);
  }

  /**
   * Runs up to `count` steps. An abort takes effect after the current step, and the run can continue.
   *
   * @returns the last step that ran, or null if none was left.
   * @throws {@link GravisightError} `data` if the videos contain fewer than two usable flights, or differ from those of the resumed run.
   */
  async step(count = 1, options: AdaptStepOptions = {}): Promise<AdaptStep | null> {
    let last: AdaptStep | null = null;
    for (let made = 0; made < count; made++) {
      options.signal?.throwIfAborted();
      const step = await this.#transport.call("adaptStep", {}, { signal: options.signal });
      if (!step) break;
      last = step;
      options.onStep?.(step);
    }
    return last;
  }

  /** The number of steps done, and the total over all networks. */
  progress(): Promise<AdaptProgress> {
    return this.#transport.call("adaptProgress", {});
  }

  /** Saves the run for {@link resume}, without the videos: about 16 bytes per weight. Available after the first step. */
  checkpoint(): Promise<Uint8Array> {
    return this.#transport.call("adaptCheckpoint", {});
  }

  /**
   * Returns the adapted model under the name `name`. It keeps a new network only if that did better on the held-out flights; detector and verifier
   * count as one.
   *
   * @throws {@link GravisightError} `data` if none did; `value` for an invalid name, or before the last step.
   */
  finish(name: string, options: { signal?: AbortSignal } = {}): Promise<AdaptedModel> {
    return this.#transport.call("adaptFinish", { name: String(name) }, options);
  }

  /** Frees its memory and ends its Worker; one that you gave goes on. Harmless twice. */
  dispose(): void {
    this.#transport.close(disposed("Adapter"));
  }
}
makeDisposable(Adapter);
