/** The engine: the wasm core, and all that it holds for one object. In a Worker, or on the caller's own thread. */
import type * as Core from "../wasm/cpu/gravisight.js";
import { errorOfCore, loadBuild, type CoreModule } from "./builds.js";
import { GravisightError } from "./error.js";
import { deviceOf, load, loadModel, pickDevice, type Loaded } from "./load.js";
import { release } from "./picture.js";
import type { Answer, CallName, Calls, Request, Source } from "./protocol.js";
import { untilTrap } from "./trap.js";
import type { Device, Progress } from "./types.js";

type OnProgress = (progress: Progress) => void;

/** Errors of a device that failed, after which the CPU can go on. */
const DEVICE_FAILED = ["device", "output-not-finite", "internal"];

export class Engine {
  #module: CoreModule | undefined;
  #loaded: Loaded | undefined;
  /** The same model on the CPU, where backward passes run. */
  #saliency: Core.Localiser | undefined;
  #tracker: Core.VideoTracker | undefined;
  #tuner: { core: Core.FineTuner; device: Device } | undefined;
  #adapter: Core.Adapter | undefined;
  #scenes = new Map<number, Core.Simulator>();
  #nextScene = 0;
  /** Where the builds are. */
  #source: Source = { wasm: undefined, threads: 1 };
  /** The core's memory cannot be trusted after a trap. */
  #trapped: GravisightError | undefined;

  readonly #calls: { [K in CallName]: (request: Request<K>, onProgress: OnProgress) => Answer<K> | Promise<Answer<K>> } = {
    create: async (request, onProgress) => {
      const loaded = await load(request, onProgress, this);
      this.#dropLocaliser();
      [this.#module, this.#loaded, this.#source] = [loaded.module, loaded, { wasm: request.wasm, threads: request.threads }];
      // The core has checked it.
      return { device: loaded.device, card: JSON.parse(loaded.model.card) as Core.Card };
    },
    localise: (request) => this.#localise(request),
    saliency: async ({ picture }) => (await this.#onCpu()).saliency(picture),
    addFrame: async ({ picture, time, camera, config, court, sport }) => {
      const known = court ?? (sport === undefined ? undefined : this.#core.courtWithLines(sport));
      const tracker = (this.#tracker ??= present(this.#loaded).core.tracker(camera, config, known));
      await tracker.add(picture, time);
      return "data" in picture && picture.data instanceof Uint8Array ? (picture.data as Uint8Array<ArrayBuffer>) : null;
    },
    trackVideo: ({ known, config }, onProgress) => {
      const tracker = (this.#tracker ??= present(this.#loaded).core.tracker(undefined, config));
      return tracker.track(known, (loaded: number, total: number) => onProgress({ stage: "fit", loaded, total }));
    },

    open: async (source, onProgress) => {
      this.#module ??= await loadBuild("cpu", source, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
      return null;
    },
    fitTrack: ({ frames, camera, scene, noisePx, estimate, cameraSigma, cameraAssumed }) =>
      this.#core.fitTrack(frames, camera, scene, noisePx, estimate, cameraSigma, cameraAssumed),
    scenes: () => this.#core.scenes(),
    scene: ({ name }) => this.#core.scene(name),
    sceneWithBall: ({ scene, radius }) => this.#core.sceneWithBall(scene, radius),
    forecast: ({ scene, start, times }) => this.#core.forecast(scene, Float64Array.from(start), Float64Array.from(times)),
    calibrate: ({ points, estimate, picture }) => this.#core.calibrate(points, estimate, picture),
    findCourt: ({ picture, court, estimate }) => this.#core.findCourt(picture, court, estimate),
    courts: () => this.#core.courts(),
    court: ({ name }) => this.#core.court(name),
    project: ({ camera, points }) => this.#core.project(camera, Float64Array.from(points)),
    ballAt: ({ camera, circle, radius, cameraSigma }) => this.#core.ballAt(camera, circle, radius, cameraSigma),
    assumedCamera: ({ known }) => this.#core.assumedCamera(known),
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
      const { module, model, kind, reason } = await this.#loadToTrain(request, onProgress);
      const core = await module.FineTuner.create(model.card, model.weights, request.options, kind);
      const device = deviceOf(core, kind, reason);
      this.#tuner = { core, device };
      return device;
    },
    resumeTuner: async (request, onProgress) => {
      const { module, kind, reason } = await this.#loadToResume(request, onProgress);
      const core = await module.FineTuner.resume(request.checkpoint, kind);
      const device = deviceOf(core, kind, reason);
      this.#tuner = { core, device };
      return device;
    },
    addClip: async ({ clip, pictures, heldOut }) => {
      const { core: tuner } = present(this.#tuner);
      try {
        for (const picture of pictures) await tuner.addPicture(picture);
      } catch (thrown) {
        tuner.dropPictures();
        throw thrown;
      }
      return tuner.addClip(clip, heldOut);
    },
    tune: async ({ count }) => {
      let last: Answer<"tune"> = null;
      for (let step = 0; step < count; step++) {
        const made = await present(this.#tuner).core.step();
        if (!made) break;
        last = made;
      }
      return last;
    },
    tuneProgress: () => present(this.#tuner).core.progress(),
    checkpoint: () => present(this.#tuner).core.checkpoint(),
    evaluate: () => present(this.#tuner).core.evaluate(),
    tuned: async ({ picture, camera, options }) => {
      const { core, device } = present(this.#tuner);
      const localiser = core.localiser();
      try {
        return { ...(await localiser.localise(picture, camera, options)), device };
      } finally {
        localiser.free();
      }
    },
    exportTuned: () => present(this.#tuner).core.export(),

    adapter: async (request, onProgress) => {
      const { module, model, kind, reason } = await this.#loadToTrain(request, onProgress);
      this.#adapter = await module.Adapter.create(model.card, model.weights, request.options, kind);
      return deviceOf(this.#adapter, kind, reason);
    },
    resumeAdapter: async (request, onProgress) => {
      const { module, kind, reason } = await this.#loadToResume(request, onProgress);
      this.#adapter = await module.Adapter.resume(request.checkpoint, kind);
      return deviceOf(this.#adapter, kind, reason);
    },
    adaptBegin: ({ tracked, seeds, camera, radius }) => present(this.#adapter).begin(tracked, seeds, camera, radius),
    adaptAdd: async ({ picture, time }) => (await present(this.#adapter).add(picture, time), null),
    adaptEnd: async () => (await present(this.#adapter).end(), null),
    adaptStep: async () => (await present(this.#adapter).step()) ?? null,
    adaptProgress: () => present(this.#adapter).progress(),
    adaptCheckpoint: () => present(this.#adapter).checkpoint(),
    adaptFinish: ({ name }) => present(this.#adapter).finish(name),
  };

  /** Whether there is such a call. */
  knows(type: string): type is CallName {
    return Object.hasOwn(this.#calls, type);
  }

  async call<K extends CallName>(type: K, request: Request<K>, onProgress: OnProgress): Promise<Answer<K>> {
    if (this.#trapped) throw this.#trapped;
    try {
      return await untilTrap<Calls[K][1]>(this, () => this.#calls[type](request, onProgress));
    } catch (thrown) {
      const error = errorOfCore(thrown);
      if (error.code === "internal") this.#trapped = error;
      throw error;
    } finally {
      release(request);
    }
  }

  /** Gives all memory back that can be given back. */
  free(): void {
    if (this.#trapped) return;
    this.#tracker?.free();
    this.#tracker = undefined;
    this.#dropLocaliser();
    this.#tuner?.core.free();
    this.#adapter?.free();
    for (const scene of this.#scenes.values()) scene.free();
    this.#tuner = this.#adapter = undefined;
    this.#scenes.clear();
  }

  /** The core and the model that a training starts from. */
  async #loadToTrain(request: Request<"tuner">, onProgress: OnProgress) {
    const { kind, reason } = await pickDevice(request, onProgress, this);
    const loading = loadModel(request.model, request.cache, onProgress);
    loading.catch(() => {});
    const module = (this.#module = await loadBuild(kind, request, (loaded, total) => onProgress({ stage: "wasm", loaded, total })));
    return { module, model: await loading, kind, reason };
  }

  /** The core for a training that goes on. */
  async #loadToResume(request: Request<"resumeTuner">, onProgress: OnProgress) {
    // `auto` measures with the package's own model: that of the run is in the checkpoint.
    const { kind, reason } = await pickDevice({ ...request, model: undefined }, onProgress, this);
    const module = (this.#module = await loadBuild(kind, request, (loaded, total) => onProgress({ stage: "wasm", loaded, total })));
    return { module, kind, reason };
  }

  #dropLocaliser(): void {
    if (this.#saliency !== this.#loaded?.core) this.#saliency?.free();
    this.#loaded?.core.free();
    this.#loaded = this.#saliency = undefined;
  }

  /** The model on the CPU. */
  async #onCpu(): Promise<Core.Localiser> {
    const { core, device, module, model } = present(this.#loaded);
    return (this.#saliency ??= device.kind === "cpu" ? core : await module.Localiser.create(model.card, model.weights, "cpu"));
  }

  get #core(): CoreModule {
    return present(this.#module);
  }

  async #localise({ picture, camera, options }: Request<"localise">): Promise<Answer<"localise">> {
    const loaded = present(this.#loaded);
    const run = async ({ core, device }: Loaded) => ({ ...(await core.localise(picture, camera, options)), device });
    try {
      return await untilTrap(this, () => run(loaded));
    } catch (thrown) {
      const error = errorOfCore(thrown);
      const { device, model } = loaded;
      if (device.kind !== "webgpu" || !DEVICE_FAILED.includes(error.code)) throw error;
      // The CPU's build is another module with a memory of its own, whatever has become of this one's.
      const module = await loadBuild("cpu", this.#source, () => {});
      const core = await module.Localiser.create(model.card, model.weights, "cpu");
      const reason = `WebGPU failed while in use: ${error.message}`;
      this.#module = module;
      // After a trap its memory cannot be used, not even to free something.
      if (error.code !== "internal") this.#dropLocaliser();
      this.#saliency = undefined;
      this.#loaded = { core, module, model, device: deviceOf(core, "cpu", reason) };
      return run(this.#loaded);
    }
  }
}

function present<T>(thing: T | undefined): T {
  if (thing === undefined) throw new GravisightError("not-loaded", "This is not loaded, or was already disposed of.");
  return thing;
}

