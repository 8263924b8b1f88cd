import { sourceOf } from "./builds.js";
import type { FineTuneOptions as Settings } from "../wasm/cpu/gravisight.js";
import { connect, disposed, jsonOf, makeDisposable, whole } from "./connect.js";
import { cameraOf, checkedDevice, coreOptionsOf, modelOf } from "./localiser.js";
import { pictureToSend } from "./picture.js";
import type { PictureMessage, Transport } from "./protocol.js";
import type {
  AddClipOptions,
  ClipAdded,
  Device,
  FineTuneOptions,
  FineTuneResumeOptions,
  Localisation,
  LocaliseOptions,
  Model,
  Picture,
  StepOptions,
  TrainingClip,
  TrainingFrame,
  TuneProgress,
  TuneScore,
  TuneStep,
} from "./types.js";

/** A frame's labels, as in a `clips.jsonl`. */
interface FrameLine extends Omit<TrainingFrame, "picture" | "image"> {
  file: string;
  visible: boolean;
  image?: [number, number];
}
/** A clip's labels, a line of a `clips.jsonl`. */
interface ClipLine extends Omit<TrainingClip, "frames"> {
  frames: FrameLine[];
}

/** Teaches a model a new place, camera or ball, from clips with 2D labels: the training of the command line. */
export class FineTuner {
  /** The device that was taken, and why. */
  readonly device: Device;
  readonly #transport: Transport;

  private constructor(transport: Transport, device: Device) {
    this.#transport = transport;
    this.device = device;
  }

  /**
   * Fetches the core and the model to start from.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  static async create(options: FineTuneOptions): Promise<FineTuner> {
    const { signal, onProgress, cache = true, steps, batch, crop, learningRate, supervision, seed } = options;
    signal?.throwIfAborted();
    const device = checkedDevice(options.device);
    const request = { model: modelOf(options.model), device, ...sourceOf(options), cache };
    const settings = jsonOf(whole<Partial<Settings>>({ steps, batch, crop, learningRate, supervision, seed }), "options");
    const transport = connect(options);
    try {
      const taken = await transport.call("tuner", { ...request, options: settings }, { signal, onProgress });
      return new FineTuner(transport, taken);
    } catch (thrown) {
      transport.close(disposed("FineTuner"));
      throw thrown;
    }
  }

  /**
   * Goes on from a {@link FineTuner.checkpoint}, in another page or after a reload. The clips are not in it: give those that
   * {@link progress} awaits again (in any order), then step on. On the same device the run ends as if it had never stopped, to the
   * same bits on the CPU.
   *
   * @throws {@link GravisightError}; or the reason of `signal` where it is aborted.
   */
  static async resume(checkpoint: Uint8Array, options: FineTuneResumeOptions = {}): Promise<FineTuner> {
    const { signal, onProgress, cache = true } = options;
    signal?.throwIfAborted();
    const device = checkedDevice(options.device);
    const request = { checkpoint: new Uint8Array(checkpoint), device, ...sourceOf(options), cache };
    const transport = connect(options);
    try {
      const taken = await transport.call("resumeTuner", request, { signal, onProgress, transfer: [request.checkpoint.buffer] });
      return new FineTuner(transport, taken);
    } catch (thrown) {
      transport.close(disposed("FineTuner"));
      throw thrown;
    }
  }

  /** The steps done and in all, and the clips that a resumed run still awaits. */
  progress(): Promise<TuneProgress> {
    return this.#transport.call("tuneProgress", {});
  }

  /** All that is needed to go on later, but for the clips: some 16 bytes a weight, for {@link resume}. */
  checkpoint(): Promise<Uint8Array> {
    return this.#transport.call("checkpoint", {});
  }

  /**
   * Gives a clip to learn from, or with `heldOut` to score with. All clips come before the first step.
   *
   * @returns how many of its frames teach; `leftOut` says why none does.
   */
  async addClip(clip: TrainingClip, options: AddClipOptions = {}): Promise<ClipAdded> {
    this.#transport.throwIfClosed();
    const { heldOut = false, signal } = options;
    const { id, fps, camera, scene } = clip;
    const frames = clip.frames.map(({ t, image, world }, index) =>
      whole<FrameLine>({ file: `frame ${index}`, t: t ?? index / fps, image: image ?? undefined, visible: image != null, world }),
    );
    const line = jsonOf(whole<ClipLine>({ id, fps, camera, scene, frames }), "clip");
    const pictures: PictureMessage[] = [];
    const transfer: Transferable[] = [];
    for (const { picture } of clip.frames) {
      signal?.throwIfAborted();
      const sent = await pictureToSend(picture);
      pictures.push(sent.picture);
      transfer.push(...sent.transfer);
    }
    return this.#transport.call("addClip", { clip: line, pictures, heldOut }, { transfer, signal });
  }

  /**
   * Makes `count` steps, fewer where the last comes before. An abort takes effect after the step that is under way, and
   * the tuner can go on.
   *
   * @returns the last step made; null where none was left.
   */
  async step(count = 1, options: StepOptions = {}): Promise<TuneStep | null> {
    let last: TuneStep | null = null;
    for (let made = 0; made < count; made++) {
      options.signal?.throwIfAborted();
      const step = await this.#transport.call("tune", { count: 1 }, { signal: options.signal });
      if (!step) break;
      last = step;
      options.onStep?.(step);
    }
    return last;
  }

  /** Scores the weights (their running average) on the clips held out; those that score best are exported. */
  evaluate(options: { signal?: AbortSignal } = {}): Promise<TuneScore> {
    return this.#transport.call("evaluate", {}, options);
  }

  /** Finds the ball with the weights as they are now. */
  async localise(image: Picture, options: Omit<LocaliseOptions, "saliency">): Promise<Localisation> {
    this.#transport.throwIfClosed();
    const camera = cameraOf(options.camera);
    const { picture, transfer } = await pictureToSend(image);
    const { signal } = options;
    return this.#transport.call("tuned", { picture, camera, options: coreOptionsOf(options) }, { transfer, signal });
  }

  /** The model, to be used at once or saved. The card names the file that the weights must be in. */
  export(): Promise<Model> {
    return this.#transport.call("exportTuned", {});
  }

  /** Frees its memory and ends its Worker; one that you gave goes on. Harmless twice. */
  dispose(): void {
    this.#transport.close(disposed("FineTuner"));
  }
}
makeDisposable(FineTuner);
