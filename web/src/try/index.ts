/** Joins the parts: what is looked at, on which device, and what came of it. */
import { GravisightError, type DeviceChoice, type Localiser } from "gravisight";
import { element, messageOf } from "../dom";
import type { Layer } from "../shared/maps";
import { chosenModel, OWN_MODEL, type ModelName } from "../shared/core";
import { Drop } from "./drop";
import { showKeptModels } from "./kept";
import { LoadingLine } from "./loading";
import { showModelNote } from "./model-note";
import { ResultPanel } from "./result";
import { Samples } from "./samples";
import { Session } from "./session";
import { Stage } from "./stage";
import type { Subject } from "./subject";
import "./style.css";

export interface Settings {
  device: DeviceChoice;
}

export class App {
  readonly #session = new Session();
  /** The model that is not chosen, to compare with. */
  readonly #other = new Session();
  readonly #stage = new Stage();
  readonly #result = new ResultPanel();
  readonly #loading = new LoadingLine();
  readonly #alert = element("alert");
  readonly #samples = new Samples(element("samples"), (sample) => void this.#lookAtSample(sample));
  readonly #drop = new Drop({
    onSubject: (subject) => void this.#lookAtOwn(subject),
    onPictureAlone: (picture) => void this.#showAlone(picture),
    onRefused: (message) => this.#refuse(message),
  });
  #subject: Subject | undefined;
  /** Why there is no localiser, in words. */
  #notLoaded = "";
  /** Of the run that is wanted; aborted by the next one. */
  #run = new AbortController();

  constructor() {
    this.#listenForLayer();
    element("model").hidden = OWN_MODEL !== null;
    element("model").addEventListener("change", () => this.#changeModel());
    void showKeptModels(() => this.#changeModel());
    element<HTMLInputElement>("ball").addEventListener("change", () => void this.#localise());
    for (const input of radios("device")) {
      input.addEventListener("change", () => void this.#load(input.value as DeviceChoice));
    }
  }

  /** The localiser that is ready, if there is one. */
  get localiser(): Localiser | undefined {
    return this.#session.localiser;
  }

  /** Loads the model and the samples side by side, then looks at a sample. */
  async start({ device }: Settings): Promise<void> {
    check("device", device);
    await Promise.all([this.#load(device), this.#loadSamples()]);
  }

  async #loadSamples(): Promise<void> {
    try {
      await this.#samples.load();
      // A model that the address names need not know the real one's scene.
      if (!this.#subject) this.#samples.press(OWN_MODEL === null ? "real" : "rendered");
    } catch (thrown) {
      this.#refuse(`The samples could not be loaded: ${messageOf(thrown)}`);
    }
  }

  async #load(device: DeviceChoice): Promise<void> {
    this.#say("");
    this.#loading.set("loading");
    try {
      if (!(await this.#session.load(chosenModel(), device, (progress) => this.#loading.progress(progress)))) return;
      const localiser = this.#session.localiser;
      if (localiser) {
        this.#result.showDevice(localiser.device.name, localiser.device.reason);
        showModelNote(localiser.card);
        element("ball-field").hidden = localiser.card.depth_from !== "size";
      }
      this.#showState();
      await this.#localise();
    } catch (thrown) {
      this.#notLoaded = messageOf(thrown);
      this.#stayOnLastDevice(this.#notLoaded);
    }
  }

  #changeModel(): void {
    this.#other.discard();
    void this.#load(this.#session.choice ?? "cpu");
  }

  #stayOnLastDevice(why: string): void {
    const last = this.#session.choice;
    if (last) check("device", last);
    this.#say(last ? `${why} The page keeps the previous device.` : why);
    this.#showState();
  }

  async #lookAtSample(sample: Promise<Subject>): Promise<void> {
    const run = this.#nextRun();
    try {
      const subject = await sample;
      if (!run.signal.aborted) await this.#lookAt(subject);
    } catch (thrown) {
      if (!run.signal.aborted) this.#refuse(messageOf(thrown));
    }
  }

  async #lookAtOwn(subject: Subject): Promise<void> {
    this.#samples.release();
    this.#nextRun();
    await this.#lookAt(subject);
  }

  async #showAlone(picture: File): Promise<void> {
    this.#samples.release();
    const run = this.#nextRun();
    this.#subject = undefined;
    this.#result.clear();
    const readable = await this.#stage.showPicture(picture, () => !run.signal.aborted);
    if (run.signal.aborted) return;
    if (!readable) this.#drop.forget("picture");
    this.#say(readable ? `${picture.name} needs its camera.json: drop it, too.` : `${picture.name} is not a picture that this browser can read.`);
  }

  async #lookAt(subject: Subject): Promise<void> {
    const run = this.#run;
    this.#subject = subject;
    await this.#stage.showPicture(subject.picture, () => !run.signal.aborted);
    if (!run.signal.aborted) await this.#localise();
  }

  /** Localises what is looked at, if the model is there; loading ends with this, too. */
  async #localise(): Promise<void> {
    const { localiser } = this.#session;
    const subject = this.#subject;
    if (!subject) return;
    if (!localiser) {
      if (!this.#session.isLoading) this.#refuse(`The model is not loaded: ${this.#notLoaded}`);
      return;
    }
    const { signal } = this.#nextRun();
    this.#say("");
    this.#loading.set("localising");
    try {
      const result = await localiser.localise(subject.picture, options(subject, signal));
      if (signal.aborted) return;
      this.#result.show(result, subject, localiser.card);
      this.#stage.showResult(result, subject.truth?.image);
      if (subject.truth && OWN_MODEL === null) void this.#compare(subject, signal);
    } catch (thrown) {
      if (signal.aborted) return;
      this.#refuse(`${subject.name}: ${messageOf(thrown)}`);
      this.#afterFailure(thrown, subject);
    }
    if (!signal.aborted) this.#showState();
  }

  /** Shows how far off the other model is on a sample; nothing without a network, or where it cannot be loaded. */
  async #compare(subject: Subject, signal: AbortSignal): Promise<void> {
    if (!navigator.onLine) return;
    const name: ModelName = chosenModel() === "any" ? "sd-l" : "any";
    try {
      if (!this.#other.localiser && !(await this.#other.load(name, "cpu", () => {}))) return;
      const result = await this.#other.localiser?.localise(subject.picture, { ...options(subject, signal), heatmap: false, depthMap: false });
      if (result && !signal.aborted) this.#result.showOther(name, result);
    } catch {
      // The comparison is optional: its failure is ignored.
    }
  }

  /** What the core refused must not spoil what comes next. */
  #afterFailure(thrown: unknown, subject: Subject): void {
    const code = thrown instanceof GravisightError ? thrown.code : "internal";
    if (!subject.ball) this.#drop.forget(code.startsWith("camera") ? "camera" : "picture");
    if (code !== "internal" && code !== "worker") return;
    const device = this.#session.choice ?? "cpu";
    const why = this.#alert.textContent ?? "";
    this.#session.discard();
    this.#subject = undefined;
    void this.#load(device).then(() => this.#say(why));
  }

  #nextRun(): AbortController {
    this.#run.abort();
    this.#run = new AbortController();
    return this.#run;
  }

  #refuse(message: string): void {
    this.#result.clear();
    this.#stage.clear();
    this.#say(message);
  }

  #say(message: string): void {
    this.#alert.textContent = message;
  }

  #showState(): void {
    if (this.#session.isLoading) this.#loading.set("loading");
    else this.#loading.set(this.#session.localiser ? "ready" : "not loaded");
  }

  #listenForLayer(): void {
    for (const input of radios("layer")) {
      input.addEventListener("change", () => this.#stage.setLayer(input.value as Layer));
      if (input.checked) this.#stage.setLayer(input.value as Layer);
    }
    const opacity = element<HTMLInputElement>("opacity");
    const setOpacity = () => this.#stage.setOpacity(Number(opacity.value) / 100);
    opacity.addEventListener("input", setOpacity);
    setOpacity();
  }
}

function options(subject: Subject, signal: AbortSignal): Parameters<Localiser["localise"]>[1] {
  const ball = subject.ball ?? { radius: Number(element<HTMLInputElement>("ball").value) / 200 };
  const common = { ball, camera: subject.camera, heatmap: true, depthMap: true, signal };
  return subject.truth ? { ...common, truth: subject.truth.world } : common;
}

function radios(name: string): NodeListOf<HTMLInputElement> {
  return document.querySelectorAll<HTMLInputElement>(`input[type="radio"][name="${name}"]`);
}

function check(name: string, value: string): void {
  for (const input of radios(name)) input.checked = input.value === value;
}
