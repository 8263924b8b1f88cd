/** Step 5: a model learns clips in this page, and what it gained is shown on a clip held out. */
import { FineTuner, type DeviceChoice, type FineTuneSupervision, type Model } from "gravisight";
import { messageOf } from "../dom";
import { Chart } from "../shared/chart";
import { seenIn } from "../shared/clip";
import { save } from "../shared/files";
import type { Watch } from "../shared/job";
import { Alert, fill, type Parts } from "../shared/panel";
import { workspace } from "../shared/workspace";
import { check, ready, type ReadyClip } from "./check";
import { ClipChoices, makeExamples, missingIn, trainingClip } from "./clips";
import { KeptList } from "./kept";
import { figuresOf, followedIn, foundIn, looksOf } from "./looks";
import markup from "./panel.html?raw";
import { alone, forgetRun, keep, keptRun, type Run } from "./run";
import { isKnown, showScores } from "./scores";
import "./style.css";

/** Scores of a run, the one before it left out. */
const SCORES = 6;
const CAMERAS = 9;
/** A run is kept so often, ms: what a reload costs at most. */
const KEEP_EVERY = 5000;
/** The published model for any ball learns best from this on; the others from the package's default. */
const LEARNING_RATES: Record<string, number> = { any: 5e-4 };

export async function start(panel: HTMLElement): Promise<void> {
  await new Tune(panel).open();
}

class Tune {
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #loss: Chart;
  readonly #score: Chart;
  readonly #clips: ClipChoices;
  readonly #kept: KeptList;
  /** Whether a person has chosen the model to start from; else the clips decide. */
  #isModelChosen = false;
  #stop: AbortController | undefined;
  #tuner: FineTuner | undefined;

  constructor(panel: HTMLElement) {
    this.#part = fill(panel, markup);
    this.#alert = new Alert(this.#part("tune-alert"));
    this.#clips = new ClipChoices(this.#part("tune-clips"), this.#part("tune-empty"));
    this.#loss = new Chart(this.#part("tune-loss"), "tune-loss-chart");
    this.#score = new Chart(this.#part("tune-score"), "tune-score-chart");
    const cameras = this.#part<HTMLSelectElement>("tune-camera");
    for (let number = 2; number <= CAMERAS; number++) cameras.append(new Option(String(number), String(number)));
    this.#part("tune-example").addEventListener("click", () => void this.#busy((signal) => this.#makeExamples(signal)));
    this.#part("tune-start").addEventListener("click", () => void this.#busy((signal) => alone(false, () => this.#learn(signal))));
    this.#part("tune-continue").addEventListener("click", () => void this.#busy((signal) => alone(false, () => this.#resume(signal))));
    this.#part("tune-stop").addEventListener("click", () => this.#stop?.abort());
    this.#part("tune-save").addEventListener("click", () => void this.#alert.during(() => this.#save()));
    this.#kept = new KeptList(this.#part, this.#alert, () => this.#model());
    this.#part("tune-model").addEventListener("change", () => (this.#isModelChosen = true));
    this.#part("tune-clips").addEventListener("change", () => this.#chooseModel());
    workspace.addEventListener("clips", () => void this.#updateClips());
  }

  /** Goes on with a run that a reload broke off. */
  async open(): Promise<void> {
    await Promise.all([this.#updateClips(), this.#kept.update()]);
    const run = await keptRun();
    this.#offer(run);
    if (run?.state !== "running") return;
    // Where another tab has it, it may have ended by the time that it is free.
    void alone(true, async () => {
      if ((await keptRun())?.state === "running") await this.#busy((signal) => this.#resume(signal));
    });
  }

  async #updateClips(): Promise<void> {
    await this.#clips.update();
    this.#chooseModel();
  }

  /** Clips of one's own start from the model for any ball; the examples from that of their scene. */
  #chooseModel(): void {
    if (this.#isModelChosen || this.#stop) return;
    const used = this.#clips.all.filter(({ use }) => use.checked);
    const isExample = used.length > 0 && used.every(({ clip }) => clip.truth);
    this.#part<HTMLSelectElement>("tune-model").value = isExample ? "sd-s" : "any";
  }

  /** The button that goes on with a kept run, where there is one. */
  #offer(run: Run | undefined): void {
    const button = this.#part<HTMLButtonElement>("tune-continue");
    button.hidden = !run;
    button.textContent = run?.state === "done" ? "Show the last run" : "Continue the last run";
  }

  /** One job at a time, which Stop ends. */
  async #busy(work: (signal: AbortSignal) => Promise<void>): Promise<void> {
    if (this.#stop) return;
    const stop = (this.#stop = new AbortController());
    const buttons = ["tune-example", "tune-start", "tune-continue"].map((name) => this.#part<HTMLButtonElement>(name));
    for (const button of buttons) button.disabled = true;
    this.#part<HTMLButtonElement>("tune-stop").disabled = false;
    this.#part("tune-progress").hidden = false;
    await this.#alert.during(() => work(stop.signal));
    if (stop.signal.aborted) this.#say("Stopped.");
    else if (this.#part("tune-alert").textContent) this.#say("Nothing is running.");
    for (const button of buttons) button.disabled = false;
    this.#part<HTMLButtonElement>("tune-stop").disabled = true;
    this.#part("tune-progress").hidden = true;
    this.#offer(await keptRun());
    this.#stop = undefined;
  }

  async #makeExamples(signal: AbortSignal): Promise<void> {
    this.#say("Drawing clips…");
    const camera = Number(this.#part<HTMLSelectElement>("tune-camera").value);
    await makeExamples(camera, (fraction) => this.#progress(fraction), signal);
    this.#say("Five clips are ready.");
  }

  async #learn(signal: AbortSignal): Promise<void> {
    const missing = missingIn(this.#clips.all);
    if (missing) throw new Error(missing);
    const chosen = this.#clips.all.filter(({ use }) => use.checked).map(({ clip, heldOut }) => ({ clip: ready(clip), heldOut: heldOut.checked }));
    const shown = chosen.find(({ heldOut }) => heldOut)!.clip;
    const steps = Math.round(Number(this.#part<HTMLInputElement>("tune-steps").value));
    if (!(steps >= 1 && steps <= 5000)) throw new Error("Steps must be a number from 1 to 5000.");
    const choice = (name: string) => this.#part<HTMLSelectElement>(name).value;
    const [model, device] = [choice("tune-model"), choice("tune-device") as DeviceChoice];
    const supervision = choice("tune-supervision") as FineTuneSupervision;
    this.#dispose();
    await this.#check(chosen.map(({ clip }) => clip), signal);
    await forgetRun();
    this.#say("Evaluating the held-out clip…");
    const url = new URL(`models/${model}.json`, document.baseURI).href;
    const before = await looksOf(url, shown, signal, (fraction) => this.#progress(fraction));
    const found = { before: foundIn(shown, before), of: before.length };
    const followed = model === "any" && { before: await followedIn(url, shown, this.#watch(signal)), of: seenIn(shown).length };
    const learningRate = LEARNING_RATES[model];
    const tuner = await FineTuner.create({ model: url, device, steps, supervision, ...(learningRate && { learningRate }), signal });
    this.#tuner = tuner;
    const leftOut = await this.#give(tuner, chosen, signal);
    if (leftOut.length > 0) this.#alert.say(leftOut.join(" "));
    const first = await tuner.evaluate({ signal });
    const scores: [number, number][] = isKnown(first.forecastPx) ? [[0, first.forecastPx]] : [];
    const clips = chosen.map(({ clip, heldOut }) => ({ id: clip.id, heldOut }));
    const checkpoint = await tuner.checkpoint();
    await this.#go({ state: "running", model, supervision, device, steps, clips, before, found, ...(followed && { followed }), first, last: first, losses: [], scores, spent: 0, checkpoint }, tuner, shown, signal);
  }

  /** Goes on with the kept run. */
  async #resume(signal: AbortSignal): Promise<void> {
    const run = await keptRun();
    if (!run) return;
    try {
      const chosen = await Promise.all(
        run.clips.map(async ({ id, heldOut }) => {
          const clip = await workspace.clip(id);
          if (!clip) throw new Error(`The last run cannot be continued: its clip "${id}" was deleted.`);
          return { clip: ready(clip), heldOut };
        }),
      );
      const shown = chosen.find(({ heldOut }) => heldOut)?.clip;
      if (!shown) throw new Error("The last run cannot be continued: none of its clips is held out.");
      this.#dispose();
      for (const [name, value] of Object.entries({ model: run.model, supervision: run.supervision, device: run.device, steps: String(run.steps) })) {
        this.#part<HTMLSelectElement>(`tune-${name}`).value = value;
      }
      this.#say("Continuing the last run…");
      const tuner = await FineTuner.resume(run.checkpoint, { device: run.device, signal });
      this.#tuner = tuner;
      await this.#give(tuner, chosen, signal);
      if (run.state !== "done") run.state = "running";
      await this.#go(run, tuner, shown, signal);
    } catch (thrown) {
      // Once it has failed, only a click tries again.
      const kept = await keptRun();
      if (kept?.state === "running") await keep({ ...kept, state: "stopped" });
      throw thrown;
    }
  }

  /** Refuses clips that nothing can be learned from, before anything slow. */
  async #check(clips: ReadyClip[], signal: AbortSignal): Promise<void> {
    for (const [index, clip] of clips.entries()) {
      this.#say(`Checking clip ${index + 1} of ${clips.length}…`);
      this.#progress(index / clips.length);
      await check(clip, signal);
    }
  }

  /** Gives the clips; returns why some are left out. */
  async #give(tuner: FineTuner, chosen: { clip: ReadyClip; heldOut: boolean }[], signal: AbortSignal): Promise<string[]> {
    const leftOut: string[] = [];
    for (const [index, { clip, heldOut }] of chosen.entries()) {
      this.#say(`Preparing clip ${index + 1} of ${chosen.length}…`);
      this.#progress(index / chosen.length);
      const added = await tuner.addClip(trainingClip(clip), { heldOut, signal });
      if (added.leftOut) leftOut.push(`"${clip.id}" is left out: ${added.leftOut}.`);
    }
    return leftOut;
  }

  /** The steps that are left, and what they brought. */
  async #go(run: Run, tuner: FineTuner, shown: ReadyClip, signal: AbortSignal): Promise<void> {
    const { steps } = run;
    for (const name of ["tune-save", "tune-keep"]) this.#part<HTMLButtonElement>(name).disabled = true;
    let made = (await tuner.progress()).step;
    const every = Math.max(1, Math.ceil(steps / SCORES));
    const [began, before, from] = [performance.now(), run.spent, made];
    let kept = 0;
    const keepNow = async () => {
      run.checkpoint = await tuner.checkpoint();
      // Without room it goes on all the same.
      await keep(run).catch((thrown: unknown) => this.#alert.say(`This browser cannot keep the run, which will be lost on a reload: ${messageOf(thrown)}`));
      kept = performance.now();
    };
    this.#showLosses(run);
    this.#showScores(run);
    try {
      if (run.state === "running") await keepNow();
      while (made < steps) {
        const step = await tuner.step(1, { signal });
        if (!step) break;
        made = step.step;
        run.losses.push([made, step.loss]);
        const spent = performance.now() - began;
        run.spent = before + spent;
        this.#say(`Step ${made} of ${steps}, about ${durationText((spent / (made - from)) * (steps - made))} left`);
        this.#progress(made / steps);
        this.#showLosses(run);
        const isScored = made % every === 0 || made === steps;
        if (isScored) {
          run.last = await tuner.evaluate({ signal });
          if (isKnown(run.last.forecastPx)) run.scores.push([made, run.last.forecastPx]);
          this.#showScores(run);
        }
        if (isScored || performance.now() - kept > KEEP_EVERY) await keepNow();
      }
      if (!run.now) {
        this.#say("Evaluating the held-out clip again…");
        const best = await tuner.export();
        const now = await looksOf(best, shown, signal, (fraction) => this.#progress(fraction));
        run.found = { before: foundIn(shown, run.before), now: foundIn(shown, now), of: now.length };
        if (run.followed) run.followed.now = await followedIn(best, shown, this.#watch(signal));
        run.now = now;
        this.#showScores(run);
      }
      run.state = "done";
    } catch (thrown) {
      run.state = "stopped";
      throw thrown;
    } finally {
      // A step that was under way when it was stopped has been made. A failure is already shown.
      await keepNow().catch(() => {});
    }
    this.#part("tune-frames").replaceChildren(...(await figuresOf(shown, run.before, run.now)));
    for (const name of ["tune-save", "tune-keep"]) this.#part<HTMLButtonElement>(name).disabled = false;
    this.#kept.offer(run.clips.find(({ heldOut }) => !heldOut)?.id ?? run.model);
    this.#say(`Done: ${steps} steps in ${durationText(run.spent)} on ${tuner.device.name}.`);
  }

  #showLosses({ losses, steps }: Run): void {
    this.#loss.show({ y: "Loss", x: "Step", series: [{ name: "on the clips learned from", colour: "--accent", line: losses }], from: 0, to: steps });
  }

  #showScores(run: Run): void {
    const { scores, steps } = run;
    const series = { name: "on the held-out clip", colour: "--found", line: scores, dots: scores };
    this.#score.show({ y: "Forecast error (px)", x: "Step", series: [series], from: 0, to: steps });
    this.#part("tune-none").hidden = true;
    this.#part("tune-scores").hidden = false;
    showScores(this.#part("tune-table"), this.#part("tune-missing"), run);
  }

  async #model(): Promise<Model | undefined> {
    return this.#tuner?.export();
  }

  async #save(): Promise<void> {
    const model = await this.#model();
    if (!model) return;
    const { card, weights } = model;
    const { name, weights: file } = JSON.parse(card) as { name: string; weights: string };
    save(`${name}.json`, card);
    save(file, new Blob([weights as Uint8Array<ArrayBuffer>], { type: "application/octet-stream" }));
  }

  #dispose(): void {
    this.#tuner?.dispose();
    this.#tuner = undefined;
  }

  #watch(signal: AbortSignal): Watch {
    return { signal, progress: (done, of) => this.#progress(of ? done / of : 0) };
  }

  #progress(fraction: number): void {
    this.#part<HTMLProgressElement>("tune-progress").value = fraction;
  }

  #say(text: string): void {
    this.#part("tune-status").textContent = text;
  }
}

function durationText(milliseconds: number): string {
  const seconds = Math.round(milliseconds / 1000);
  return seconds < 90 ? `${seconds} s` : `${Math.round(seconds / 60)} minutes`;
}
