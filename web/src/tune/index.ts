/** Step 5: a model learns clips in this page, and what it gained is shown on a clip held out. */
import { FineTuner, Localiser, type DeviceChoice, type Localisation, type TuneScore } from "gravisight";
import { contextOf, make } from "../dom";
import { Chart } from "../shared/chart";
import { save } from "../shared/files";
import { drawFound, drawTruth } from "../shared/marks";
import { Alert, fill, type Parts } from "../shared/panel";
import { workspace, type StoredClip } from "../shared/workspace";
import { ClipChoices, makeExamples, trainingClip } from "./clips";
import markup from "./panel.html?raw";
import "./style.css";

/** Scores of a run, the one before it left out. */
const SCORES = 6;
/** Frames that are shown before and after. */
const SHOWN = 3;
const CAMERAS = 9;
const signed = new Intl.NumberFormat("en", { maximumFractionDigits: 0, signDisplay: "exceptZero" });

export async function start(panel: HTMLElement): Promise<void> {
  await new Tune(panel).open();
}

class Tune {
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #loss: Chart;
  readonly #score: Chart;
  readonly #clips: ClipChoices;
  #run: AbortController | undefined;
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
    this.#part("tune-start").addEventListener("click", () => void this.#busy((signal) => this.#learn(signal)));
    this.#part("tune-stop").addEventListener("click", () => this.#run?.abort());
    this.#part("tune-save").addEventListener("click", () => void this.#alert.during(() => this.#save()));
    workspace.addEventListener("clips", () => void this.#clips.update());
  }

  async open(): Promise<void> {
    await this.#clips.update();
  }

  /** One job at a time, which Stop ends. */
  async #busy(work: (signal: AbortSignal) => Promise<void>): Promise<void> {
    if (this.#run) return;
    const run = (this.#run = new AbortController());
    const buttons = ["tune-example", "tune-start"].map((name) => this.#part<HTMLButtonElement>(name));
    for (const button of buttons) button.disabled = true;
    this.#part<HTMLButtonElement>("tune-stop").disabled = false;
    this.#part("tune-progress").hidden = false;
    await this.#alert.during(() => work(run.signal));
    if (run.signal.aborted) this.#say("Stopped.");
    else if (this.#part("tune-alert").textContent) this.#say("Nothing is running.");
    for (const button of buttons) button.disabled = false;
    this.#part<HTMLButtonElement>("tune-stop").disabled = true;
    this.#part("tune-progress").hidden = true;
    this.#run = undefined;
  }

  async #makeExamples(signal: AbortSignal): Promise<void> {
    this.#say("Drawing clips…");
    const camera = Number(this.#part<HTMLSelectElement>("tune-camera").value);
    await makeExamples(camera, (share) => this.#progress(share), signal);
    this.#say("Five clips are ready.");
  }

  async #learn(signal: AbortSignal): Promise<void> {
    const chosen = this.#clips.all.filter(({ use }) => use.checked);
    const [learned, held] = [chosen.filter(({ heldOut }) => !heldOut.checked), chosen.filter(({ heldOut }) => heldOut.checked)];
    const shown = held[0]?.clip;
    if (learned.length === 0) throw new Error("Choose at least one clip to learn from (not held out).");
    if (!shown) throw new Error("Hold one clip out: without it nobody knows whether learning helped.");
    const steps = Math.round(Number(this.#part<HTMLInputElement>("tune-steps").value));
    if (!(steps >= 1 && steps <= 5000)) throw new Error("Steps must be a number from 1 to 5000.");
    const model = new URL(`models/${this.#part<HTMLSelectElement>("tune-model").value}.json`, document.baseURI).href;
    const device = this.#part<HTMLSelectElement>("tune-device").value as DeviceChoice;
    this.#dispose();
    this.#part<HTMLButtonElement>("tune-save").disabled = true;
    this.#say("Fetching the core and the model…");
    const before = await framesBefore(model, shown, signal);
    const tuner = await FineTuner.create({ model, device, steps, signal });
    this.#tuner = tuner;
    const leftOut: string[] = [];
    for (const [index, { clip, heldOut }] of chosen.entries()) {
      this.#say(`Physics is fitted to clip ${index + 1} of ${chosen.length}…`);
      this.#progress(index / chosen.length);
      const added = await tuner.addClip(trainingClip(clip), { heldOut: heldOut.checked, signal });
      if (added.leftOut) leftOut.push(`"${clip.id}" teaches nothing: ${added.leftOut}.`);
    }
    if (leftOut.length > 0) this.#alert.say(leftOut.join(" "));
    const first = await tuner.evaluate({ signal });
    const losses: [number, number][] = [];
    const scores: [number, number][] = [];
    const score = (made: number, now: TuneScore) => {
      if (typeof now.forecastPx === "number") scores.push([made, now.forecastPx]);
      this.#showScores(scores, steps, first, now);
    };
    score(0, first);
    const every = Math.max(1, Math.ceil(steps / SCORES));
    const began = performance.now();
    for (let made = 0; made < steps; ) {
      const count = Math.min(every, steps - made);
      await tuner.step(count, {
        signal,
        onStep: ({ step, loss }) => {
          losses.push([step, loss]);
          const left = ((performance.now() - began) / step) * (steps - step);
          this.#say(`Step ${step} of ${steps}, about ${words(left)} left`);
          this.#progress(step / steps);
          this.#loss.show({ y: "Loss", x: "Step", series: [{ name: "on the clips learned from", colour: "--accent", line: losses }], from: 0, to: steps });
        },
      });
      made += count;
      score(made, await tuner.evaluate({ signal }));
    }
    await this.#showFrames(shown, before, tuner, signal);
    this.#part<HTMLButtonElement>("tune-save").disabled = false;
    this.#say(`Done: ${steps} steps in ${words(performance.now() - began)} on ${tuner.device.name}.`);
  }

  #showScores(scores: [number, number][], steps: number, before: TuneScore, now: TuneScore): void {
    const series = { name: "on the clip held out", colour: "--found", line: scores, dots: scores };
    this.#score.show({ y: "Forecast error (px)", x: "Step", series: [series], from: 0, to: steps });
    const rows: [string, number | null | undefined, number | null | undefined, (value: number) => string][] = [
      ["Forecast 15 frames away, median", before.forecastPx, now.forecastPx, (value) => `${value.toFixed(2)} px`],
      ["2D error, median", before.imageErrorPx.median, now.imageErrorPx.median, (value) => `${value.toFixed(2)} px`],
      ["Distance to the truth, mean (where it is known)", before.dtg.mean, now.dtg.mean, (value) => `${(100 * value).toFixed(1)} cm`],
    ];
    this.#part("tune-none").hidden = true;
    this.#part("tune-scores").hidden = false;
    const cells = (...texts: string[]) => texts.map((text) => make("td", { text }));
    this.#part("tune-table").replaceChildren(
      ...rows.map(([name, a, b, say]) => {
        const header = make("th", { text: name });
        header.scope = "row";
        const known = typeof a === "number" && typeof b === "number";
        const change = known && a > 0 ? `${signed.format(100 * (b / a - 1))} %` : "–";
        return make("tr", {}, header, ...(known ? cells(say(a), say(b), change) : cells("–", "–", "–")));
      }),
    );
  }

  async #showFrames(clip: StoredClip, before: Localisation[], tuner: FineTuner, signal: AbortSignal): Promise<void> {
    const figures: HTMLElement[] = [];
    for (const [index, frame] of framesOf(clip).entries()) {
      const picture = clip.pictures[frame];
      const first = before[index];
      if (!picture || !first) continue;
      const now = await tuner.localise(picture, { camera: clip.camera, ...truthOf(clip, frame), signal });
      const canvas = await drawn(picture, clip.labels[frame] ?? undefined, now.image);
      const off = (found: Localisation) => (found.dtg === undefined ? `${found.depth.toFixed(2)} m deep` : `${(100 * found.dtg).toFixed(1)} cm off`);
      figures.push(make("figure", {}, canvas, make("figcaption", { text: `Frame ${frame}: ${off(first)} before, ${off(now)} now` })));
    }
    this.#part("tune-frames").replaceChildren(...figures);
  }

  async #save(): Promise<void> {
    if (!this.#tuner) return;
    const { card, weights } = await this.#tuner.export();
    const { name, weights: file } = JSON.parse(card) as { name: string; weights: string };
    save(`${name}.json`, card);
    save(file, new Blob([weights as Uint8Array<ArrayBuffer>], { type: "application/octet-stream" }));
  }

  #dispose(): void {
    this.#tuner?.dispose();
    this.#tuner = undefined;
  }

  #progress(share: number): void {
    this.#part<HTMLProgressElement>("tune-progress").value = share;
  }

  #say(words: string): void {
    this.#part("tune-status").textContent = words;
  }
}

/** Frames of the clip held out, spread over those with a label. */
function framesOf({ labels }: StoredClip): number[] {
  const seen = labels.flatMap((label, index) => (label ? [index] : []));
  return Array.from({ length: Math.min(SHOWN, seen.length) }, (_, index) => seen[Math.floor(((index + 0.5) * seen.length) / SHOWN)] ?? 0);
}

async function framesBefore(model: string, clip: StoredClip, signal: AbortSignal): Promise<Localisation[]> {
  const localiser = await Localiser.create({ model, camera: clip.camera, signal });
  try {
    const found: Localisation[] = [];
    for (const frame of framesOf(clip)) {
      const picture = clip.pictures[frame];
      if (picture) found.push(await localiser.localise(picture, { ...truthOf(clip, frame), signal }));
    }
    return found;
  } finally {
    localiser.dispose();
  }
}

function truthOf({ truth }: StoredClip, frame: number): { truth?: [number, number, number] } {
  const world = truth?.[frame];
  return world ? { truth: world } : {};
}

async function drawn(picture: Blob, label: [number, number] | undefined, found: [number, number]): Promise<HTMLCanvasElement> {
  const bitmap = await createImageBitmap(picture);
  const canvas = make("canvas");
  const scale = 448 / bitmap.width;
  [canvas.width, canvas.height] = [448, Math.round(bitmap.height * scale)];
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "A frame of the clip held out with the ball found and its label");
  const context = contextOf(canvas);
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  drawFound(context, [(found[0] + 0.5) * scale, (found[1] + 0.5) * scale]);
  if (label) drawTruth(context, [(label[0] + 0.5) * scale, (label[1] + 0.5) * scale]);
  return canvas;
}

function words(milliseconds: number): string {
  const seconds = Math.round(milliseconds / 1000);
  return seconds < 90 ? `${seconds} s` : `${Math.round(seconds / 60)} minutes`;
}
