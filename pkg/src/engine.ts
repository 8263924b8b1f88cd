/** The engine: the wasm core and all that it holds. In a Worker, or on the caller's own thread. */
import { lastPanic, loadBuild } from "./builds.js";
import { GravisightError, gravisightErrorFrom } from "./error.js";
import { load, loadModel, pickDevice } from "./load.js";
import { addPicture, pixelsOf, type Encoded, type Rgba } from "./pixels.js";
import type { Answer, CallName, Calls, Request } from "./protocol.js";
import type { RawFineTuner, RawLocaliser, RawModule, RawSimulator } from "./raw.js";
import { untilTrap } from "./trap.js";
import type { Device, Model, Progress } from "./types.js";

type OnProgress = (progress: Progress) => void;

/** Errors of a device that failed, after which the CPU can go on. */
const DEVICE_FAILED = ["device", "output-not-finite", "internal"];

export class Engine {
  #module: RawModule | undefined;
  #localiser: RawLocaliser | undefined;
  /** The same model in a build that has backward passes. */
  #saliency: RawLocaliser | undefined;
  #model: Model | undefined;
  #device: Device | undefined;
  #tuner: RawFineTuner | undefined;
  #scenes = new Map<number, RawSimulator>();
  #nextScene = 0;
  #source: string | undefined;
  /** The core's memory cannot be trusted after a trap. */
  #trapped: GravisightError | undefined;

  readonly #calls: { [K in CallName]: (request: Request<K>, onProgress: OnProgress) => Answer<K> | Promise<Answer<K>> } = {
    create: async (request, onProgress) => {
      const { core, device, model, module } = await load(request, onProgress);
      this.#localiser?.free();
      this.#saliency?.free();
      this.#saliency = undefined;
      [this.#module, this.#localiser, this.#device, this.#model, this.#source] = [module, core, device, model, request.wasm];
      return device;
    },
    localise: (request) => this.#localise(request),
    saliency: async ({ picture }) => {
      const core = (this.#saliency ??= await this.#withTools());
      const input = pixelsOf(picture);
      return input.kind === "encoded" ? core.saliency(input.bytes) : core.saliencyRgba(input.rgba, input.width, input.height);
    },

    open: async ({ wasm }, onProgress) => {
      this.#module ??= await loadBuild("tools", wasm, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
      return null;
    },
    fitTrack: ({ frames, camera, scene, noisePx, estimate }) => this.#core.fitTrack(frames, camera, scene, noisePx, estimate),
    forecast: ({ scene, start, times }) => this.#core.forecast(scene, Float64Array.from(start), Float64Array.from(times)),
    calibrate: ({ points, estimate }) => this.#core.calibrate(points, estimate),
    courts: () => this.#core.courts(),
    court: ({ name }) => this.#core.court(name),
    project: ({ camera, points }) => this.#core.project(camera, Float64Array.from(points)),
    proposeLabels: ({ camera, pictures, radiiPx }) => {
      const labeller = new this.#core.Labeller(camera);
      try {
        for (const picture of pictures) addPicture(labeller, picture);
        return labeller.propose(radiiPx && Float64Array.from(radiiPx));
      } finally {
        labeller.free();
      }
    },
    openScene: ({ environment, camera }) => {
      const scene = new this.#core.Simulator(environment, camera);
      const id = this.#nextScene++;
      this.#scenes.set(id, scene);
      return { id, camera: scene.camera, scene: scene.scene };
    },
    scenePath: ({ id, start, times }) => present(this.#scenes.get(id)).path(Float64Array.from(start), Float64Array.from(times)),
    scenePicture: ({ id, centre }) => present(this.#scenes.get(id)).picture(Float64Array.from(centre)),
    sceneClip: ({ id, seed, number }) => present(this.#scenes.get(id)).clip(seed, number),
    closeScene: ({ id }) => {
      this.#scenes.get(id)?.free();
      this.#scenes.delete(id);
      return null;
    },

    tuner: async (request, onProgress) => {
      const { kind, reason } = await pickDevice(request.device);
      const model = loadModel(request.model, request.cache, onProgress);
      model.catch(() => {});
      this.#module = await loadBuild(kind === "cpu" ? "tools" : kind, request.wasm, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
      const { card, weights } = await model;
      this.#tuner = await this.#module.FineTuner.create(card, weights, request.options, kind);
      return (this.#device = { kind, name: this.#tuner.deviceName, reason });
    },
    addClip: ({ clip, pictures, heldOut }) => {
      const tuner = present(this.#tuner);
      try {
        for (const picture of pictures) addPicture(tuner, picture);
      } catch (thrown) {
        tuner.dropPictures();
        throw thrown;
      }
      return tuner.addClip(clip, heldOut);
    },
    tune: async ({ count }) => {
      let last: Answer<"tune"> = null;
      for (let step = 0; step < count; step++) {
        const made = await present(this.#tuner).step();
        if (!made) break;
        last = made;
      }
      return last;
    },
    evaluate: () => present(this.#tuner).evaluate(),
    tuned: async ({ picture, camera, options }) => {
      const localiser = present(this.#tuner).localiser();
      try {
        return await this.#timed(localiser, pixelsOf(picture), camera, options);
      } finally {
        localiser.free();
      }
    },
    exportTuned: () => present(this.#tuner).export(),
  };

  /** Whether there is such a call. */
  knows(type: string): type is CallName {
    return Object.hasOwn(this.#calls, type);
  }

  async call<K extends CallName>(type: K, request: Request<K>, onProgress: OnProgress): Promise<Answer<K>> {
    if (this.#trapped) throw this.#trapped;
    try {
      return await untilTrap<Calls[K][1]>(() => this.#calls[type](request, onProgress));
    } catch (thrown) {
      const error = gravisightErrorFrom(thrown, lastPanic());
      if (error.code === "internal") this.#trapped = error;
      throw error;
    }
  }

  /** Gives all memory back that can be given back. */
  free(): void {
    if (this.#trapped) return;
    this.#localiser?.free();
    this.#tuner?.free();
    for (const scene of this.#scenes.values()) scene.free();
    this.#saliency?.free();
    this.#localiser = this.#saliency = this.#tuner = this.#model = undefined;
    this.#scenes.clear();
  }

  async #withTools(): Promise<RawLocaliser> {
    const { card, weights } = present(this.#model);
    const module = await loadBuild("tools", this.#source, () => {});
    return module.Localiser.create(card, weights, "cpu");
  }

  get #core(): RawModule {
    return present(this.#module);
  }

  async #localise({ picture, camera, options }: Request<"localise">): Promise<Answer<"localise">> {
    const input = pixelsOf(picture);
    try {
      return await untilTrap(() => this.#timed(present(this.#localiser), input, camera, options));
    } catch (thrown) {
      const error = gravisightErrorFrom(thrown, lastPanic());
      const { device, model } = { device: this.#device, model: this.#model };
      if (device?.kind !== "webgpu" || !model || !DEVICE_FAILED.includes(error.code)) throw error;
      // The CPU's build is another module with a memory of its own, whatever has become of this one's.
      this.#module = await loadBuild("cpu", this.#source, () => {});
      this.#localiser = await this.#module.Localiser.create(model.card, model.weights, "cpu");
      this.#device = { kind: "cpu", name: this.#localiser.deviceName, reason: `WebGPU failed while in use: ${error.message}` };
      return this.#timed(this.#localiser, input, camera, options);
    }
  }

  async #timed(
    core: RawLocaliser,
    input: Encoded | Rgba,
    camera: string,
    options: Request<"localise">["options"],
  ): Promise<Answer<"localise">> {
    const start = performance.now();
    const answer = await (input.kind === "encoded"
      ? core.localise(input.bytes, camera, options)
      : core.localiseRgba(input.rgba, input.width, input.height, camera, options));
    return { ...answer, milliseconds: performance.now() - start, device: present(this.#device) };
  }
}

function present<T>(thing: T | undefined): T {
  if (thing === undefined) throw new GravisightError("not-loaded", "This was not loaded, or was given back.");
  return thing;
}

