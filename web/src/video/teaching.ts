/** Teaches a model the ball of the video that was tracked, without a label: its flights are what it learns from. */
import { Adapter, type AdaptScore, GravisightError } from "gravisight";
import type { Job, Watch } from "../shared/job";
import { keptModels, loadable, MINE } from "../shared/models";
import type { ModelSelect } from "../shared/model-select";
import type { Parts } from "../shared/panel";
import type { Following } from "./following";
import type { FrameSearch } from "./frame-search";
import { chosenDevice } from "./model";
import { identityOf, isSameVideo } from "./session";
import { forgetTeaching, keepTeaching, keptTeaching, type KeptTeaching } from "./teaching-run";
import { VideoSource } from "./video-source";

/** A run is kept so often, ms: what a reload costs at most, besides the frames. */
const KEEP_EVERY = 10_000;
const MOST_STEPS = 2000;

interface With {
  part: Parts;
  frameSearch: FrameSearch;
  following: Following;
  job: Job;
  models: ModelSelect;
}

export class Teaching {
  readonly #with: With;
  /** The name that was suggested for the model, for the video before. */
  #suggested = "";

  constructor(uses: With) {
    this.#with = uses;
  }

  /** Whether there is something to learn from, and a run to go on with. */
  async showWhether(): Promise<void> {
    const { part, frameSearch } = this.#with;
    const file = this.#file;
    part("video-teach").hidden = !file || !frameSearch.result;
    const kept = file && frameSearch.result ? await this.#keptOf(file) : undefined;
    part("video-teach-continue").hidden = !kept;
    part("video-teach-continue").textContent = kept ? `Continue from step ${kept.step} of ${kept.steps}` : "";
    const name = part<HTMLInputElement>("video-teach-name");
    if (file && (!name.value || name.value === this.#suggested)) {
      this.#suggested = await unusedName(`ball of ${file.name.replace(/\.[^.]*$/, "")}`.replace(/[\\/]/g, "-"));
      name.value = this.#suggested;
    }
  }

  /** Adapts the chosen model to the video that is open. */
  async start(): Promise<void> {
    const { part, frameSearch, following, models } = this.#with;
    const { result } = frameSearch;
    const file = this.#file;
    if (!file || !result) throw new Error("Track a video first.");
    const name = part<HTMLInputElement>("video-teach-name").value.trim();
    if (!name || /[\\/]/.test(name)) throw new Error("Give the new model a name, without slashes.");
    if ((await keptModels.names()).includes(name)) throw new Error(`A model named “${name}” already exists. Choose another name.`);
    const steps = Math.round(Number(part<HTMLInputElement>("video-teach-steps").value));
    if (!(steps >= 1 && steps <= MOST_STEPS)) throw new Error(`Steps per network must be a number from 1 to ${MOST_STEPS}.`);
    const { tracked, camera } = result.record;
    const { scene } = following;
    const run = {
      video: await identityOf(file),
      name,
      tracked: { explained: tracked.explained, frames: tracked.frames },
      seeds: following.corrections.all,
      ...(camera && scene && { camera, ball: { radius: scene.ball.radius } }),
      device: chosenDevice(),
    };
    await this.#run("Loading the model…", async (watch) => {
      const model = await loadable(models.choice);
      const adapter = await Adapter.create({ model, device: run.device, threads: "auto", steps, signal: watch.signal });
      await this.#learn(adapter, file, run, watch);
    });
  }

  /** Goes on with the run that this browser kept of the video that is open. */
  async continue(): Promise<void> {
    const file = this.#file;
    const kept = file && (await this.#keptOf(file));
    if (!file || !kept) throw new Error("This browser has no saved run for this video.");
    await this.#run("Opening the run…", async (watch) => {
      const adapter = await Adapter.resume(kept.checkpoint, { device: kept.device, threads: "auto", signal: watch.signal });
      await this.#learn(adapter, file, kept, watch);
    });
  }

  async #run(message: string, work: (watch: Watch) => Promise<void>): Promise<void> {
    const { part, job, frameSearch } = this.#with;
    const buttons = ["video-teach-start", "video-teach-continue"].map((name) => part<HTMLButtonElement>(name));
    frameSearch.source?.pause();
    this.#say("");
    for (const button of buttons) button.disabled = true;
    try {
      await job.run(message, work);
    } finally {
      for (const button of buttons) button.disabled = false;
      await this.showWhether();
    }
  }

  async #learn(adapter: Adapter, file: File, run: Omit<KeptTeaching, "checkpoint" | "step" | "steps">, { signal, progress }: Watch): Promise<void> {
    signal.addEventListener("abort", () => adapter.dispose(), { once: true });
    try {
      const { flights } = await adapter.begin(run.tracked, { seeds: run.seeds, ...(run.camera && { camera: run.camera }), ...(run.ball && { ball: run.ball }) });
      if (flights > 0) await frames(file, run.tracked.frames.length, (picture, timeMs) => adapter.add(picture, timeMs), { signal, progress });
      await adapter.end();
      let kept = performance.now();
      for (;;) {
        const step = await adapter.step(1, { signal });
        if (!step) break;
        progress(step.step, step.steps, `Training the ${step.network}: step ${step.step} of ${step.steps} in total`);
        if (performance.now() - kept < KEEP_EVERY && step.step > 1) continue;
        // A browser without room goes on without.
        await keepTeaching({ ...run, step: step.step, steps: step.steps, checkpoint: await adapter.checkpoint() }).catch(() => undefined);
        kept = performance.now();
      }
      progress(0, null, "Testing the new model on flights that it did not see…");
      const { model, before, after } = await adapter.finish(run.name, { signal });
      await keptModels.keep(run.name, model);
      await this.#with.models.choose(MINE + run.name);
      this.#say(gained(run.name, before, after));
      await forgetTeaching(run.video);
    } catch (thrown) {
      // What the video does not hold, a second try would not find, either. Another error leaves the run to be continued.
      if (thrown instanceof GravisightError && thrown.code === "data") await forgetTeaching(run.video);
      throw thrown;
    } finally {
      adapter.dispose();
    }
  }

  /** The video that is open, as a file. */
  get #file(): File | undefined {
    const { source } = this.#with.frameSearch;
    return source instanceof VideoSource ? source.file : undefined;
  }

  async #keptOf(file: File): Promise<KeptTeaching | undefined> {
    const kept = await keptTeaching();
    return kept && isSameVideo(await identityOf(file), kept.video) ? kept : undefined;
  }

  #say(text: string): void {
    this.#with.part("video-teach-said").textContent = text;
  }
}

/** Gives each frame of the file, as the tracker had them. */
async function frames(file: File, count: number, add: (picture: HTMLCanvasElement | OffscreenCanvas, timeMs: number) => Promise<void>, { signal, progress }: Watch): Promise<void> {
  const { DecodedVideo } = await import("../shared/decoded");
  const decoded = await DecodedVideo.open(file);
  if (!decoded) throw new Error("This browser cannot decode this video frame by frame. Use another browser, or the command `gravisight adapt`.");
  try {
    let done = 0;
    let first: number | undefined;
    for await (const { picture, timeMs } of decoded.frames()) {
      signal.throwIfAborted();
      first ??= timeMs;
      await add(picture, timeMs - first);
      progress(++done, count, "Extracting training images from the video…");
    }
  } finally {
    decoded.close();
  }
}

/** The name, or with the first number behind it that no kept model has. */
async function unusedName(name: string): Promise<string> {
  const names = await keptModels.names();
  let unused = name;
  for (let number = 2; names.includes(unused); number++) unused = `${name} ${number}`;
  return unused;
}

function gained(name: string, before: AdaptScore, after: AdaptScore): string {
  const wrong = ({ wrong }: AdaptScore) => `${wrong} false ${wrong === 1 ? "positive" : "positives"}`;
  return (
    `“${name}” is saved in this browser and selected above. To use it, track the ball again. In ${after.balls} held-out frames, ` +
    `it reports the ball in ${after.found} (before: ${before.found}), with ${wrong(after)} (before: ${before.wrong}).`
  );
}
