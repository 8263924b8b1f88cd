/** Joins the parts: what is looked at, on which device, and what came of it. */
import { GravisightError, type DeviceChoice, type DrawnCircle, type Localisation, type Localiser } from "gravisight";
import { element, messageOf } from "../dom";
import type { Layer } from "../shared/maps";
import { chosenModel, OWN_MODEL, tools, type ModelName } from "../shared/core";
import { save } from "../shared/files";
import { Drop } from "./drop";
import { jsonOf, pictureOf, textOf } from "./export";
import { showKeptModels } from "./kept";
import { LoadingLine } from "./loading";
import { showModelNote } from "./model-note";
import { placeOf, placeOfCandidate, placeOfCircle, type Place } from "./place";
import { Pointing } from "./pointing";
import { ResultPanel } from "./result";
import { Samples } from "./samples";
import { Session } from "./session";
import { Stage } from "./stage";
import type { Subject } from "./subject";
import "./style.css";

/** Likeliest places that are offered. */
const PLACES = 5;
/** The page's files are named after the picture. */
const nameOf = ({ name }: Subject) => name.replace(/\.[^.]*$/, "").replace(/[^\p{L}\p{N}_-]+/gu, "-").toLowerCase() || "picture";

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
  readonly #pointing = new Pointing({
    circled: (circle) => void this.#showCircled(circle),
    boxed: () => void this.#localise(),
    chose: (index) => this.#choose(index),
  });
  #subject: Subject | undefined;
  /** Of the network, in the picture that is shown. */
  #found: { result: Localisation; card: Localiser["card"] } | undefined;
  /** The circle whose place is wanted, and whether one is being worked on. */
  #circle: DrawnCircle | undefined;
  #isPlacing = false;
  /** The position that is shown. */
  #place: Place | undefined;
  /** Why there is no localiser, in words. */
  #notLoaded = "";
  /** Of the run that is wanted; aborted by the next one. */
  #run = new AbortController();

  constructor() {
    this.#listenForLayer();
    element("model").hidden = OWN_MODEL !== null;
    element("model").addEventListener("change", () => this.#changeModel());
    void showKeptModels(() => this.#changeModel());
    element<HTMLInputElement>("ball").addEventListener("change", () => {
      if (this.#circle) void this.#showCircled(this.#circle);
      void this.#localise();
    });
    for (const input of radios("device")) {
      input.addEventListener("change", () => void this.#load(input.value as DeviceChoice));
    }
    this.#listenForExport();
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
        this.#pointing.allowBox(localiser.card.depth_from === "size");
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
    this.#forget();
    void this.#pointing.take(undefined, false);
    const readable = await this.#stage.showPicture(picture, () => !run.signal.aborted);
    if (run.signal.aborted) return;
    if (!readable) this.#drop.forget("picture");
    this.#say(readable ? `${picture.name} needs its camera.json: drop it, too, or press “Assume a phone, held level”.` : `${picture.name} is not a picture that this browser can read.`);
  }

  async #lookAt(subject: Subject): Promise<void> {
    const run = this.#run;
    // Numbers of the last picture must not stand beside this one.
    this.#forget();
    this.#subject = subject;
    this.#showBall();
    void this.#pointing.take(subject.picture, this.#session.localiser?.card.depth_from === "size");
    await this.#stage.showPicture(subject.picture, () => !run.signal.aborted);
    if (!run.signal.aborted) await this.#localise();
  }

  /** Forgets the picture and what was found in it. */
  #forget(): void {
    this.#subject = this.#found = this.#circle = undefined;
    this.#showPlace(undefined);
    this.#showBall();
    this.#result.clear();
  }

  /** What the field of the ball's diameter is for: a sample's ball is known. */
  #showBall(): void {
    const { ball } = this.#subject ?? {};
    element<HTMLInputElement>("ball").disabled = ball !== undefined;
    element("ball-why").textContent = ball ? `This sample’s ball is known: ${(200 * ball.radius).toFixed(1)} cm.` : "";
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
    try {
      ballOf(subject);
    } catch (thrown) {
      this.#refuse(messageOf(thrown));
      return this.#showState();
    }
    this.#loading.set("localising");
    try {
      const searches = localiser.card.depth_from === "size";
      const { region } = this.#pointing;
      const wanted = { ...options(subject, signal), ...(searches && { candidates: PLACES, cameraSigma: subject.oneSigma ?? [], ...(region && { region }) }) };
      const result = await localiser.localise(subject.picture, wanted);
      if (signal.aborted) return;
      this.#found = { result, card: localiser.card };
      // What somebody draws meanwhile counts more.
      if (!this.#circle) this.#showFound();
      if (subject.truth && OWN_MODEL === null) void this.#compare(subject, signal);
    } catch (thrown) {
      if (signal.aborted) return;
      this.#refuse(`${subject.name}: ${messageOf(thrown)}`);
      this.#afterFailure(thrown, subject);
    }
    if (!signal.aborted) this.#showState();
  }

  /** Shows what the network found. */
  #showFound(): void {
    const { result, card } = this.#found ?? {};
    const subject = this.#subject;
    if (!result || !card || !subject) return;
    this.#result.show(result, subject, card);
    this.#stage.showResult({ result, truth: subject.truth?.image, region: this.#pointing.region, chosen: undefined });
    this.#pointing.showPlaces(result.candidates ?? [], -1);
    this.#showPlace(placeOf(result, "the network"));
  }

  /** Shows one of the likeliest places. */
  #choose(index: number): void {
    const subject = this.#subject;
    const { result } = this.#found ?? {};
    const place = result && placeOfCandidate(result, index, subject?.truth?.world);
    if (!subject || !result || !place) return;
    this.#result.showPlace(place, subject);
    this.#stage.showResult({ result, truth: subject.truth?.image, region: this.#pointing.region, chosen: index });
    this.#pointing.showPlaces(result.candidates ?? [], index);
    this.#showPlace(place);
  }

  /** Shows where the ball in a circle is; without one, what the network found. The last of several circles counts. */
  async #showCircled(circle: DrawnCircle | undefined): Promise<void> {
    this.#circle = circle;
    if (!circle) return this.#showFound();
    if (this.#isPlacing) return;
    this.#isPlacing = true;
    try {
      for (let last: DrawnCircle | undefined; this.#circle && this.#circle !== last; ) {
        last = this.#circle;
        const subject = this.#subject;
        if (!subject) return;
        const found = await (await tools()).ballAt(subject.camera, last, ballOf(subject), { cameraSigma: subject.oneSigma ?? [] });
        if (subject !== this.#subject || !this.#circle) return;
        const place = placeOfCircle(found, last, subject.truth?.world);
        this.#say("");
        this.#result.showPlace(place, subject);
        this.#showPlace(place);
      }
    } catch (thrown) {
      this.#say(messageOf(thrown));
    } finally {
      this.#isPlacing = false;
    }
  }

  /** What the buttons save. */
  #showPlace(place: Place | undefined): void {
    this.#place = place;
    for (const id of ["copy", "save-json", "save-picture"]) element<HTMLButtonElement>(id).disabled = place === undefined;
    element("saved").textContent = "";
  }

  #listenForExport(): void {
    const on = (id: string, act: (place: Place, subject: Subject) => Promise<void> | void) =>
      element(id).addEventListener("click", () => {
        if (!this.#place || !this.#subject) return;
        void Promise.resolve(act(this.#place, this.#subject)).catch((thrown: unknown) => this.#say(messageOf(thrown)));
      });
    on("copy", async (place, subject) => {
      await navigator.clipboard.writeText(textOf(place, subject)).catch(() => {
        throw new Error("This browser does not let the page copy. Use “Save as JSON”.");
      });
      element("saved").textContent = "Copied.";
    });
    on("save-json", (place, subject) => save(`${nameOf(subject)}-position.json`, jsonOf(place, subject, ballOf(subject).radius)));
    on("save-picture", async ({ image, circle }, subject) =>
      save(`${nameOf(subject)}-position.png`, await pictureOf(subject.picture, image, circle, element("frame").clientWidth)),
    );
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
    this.#forget();
    void this.#load(device).then(() => this.#say(why));
  }

  #nextRun(): AbortController {
    this.#run.abort();
    this.#run = new AbortController();
    return this.#run;
  }

  #refuse(message: string): void {
    this.#showPlace(undefined);
    this.#found = undefined;
    this.#pointing.showPlaces([], -1);
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

/** The ball that is looked for: a sample's own, or the one whose diameter a person gives. */
function ballOf({ ball }: Subject): { radius: number } {
  if (ball) return ball;
  const centimetres = element<HTMLInputElement>("ball").valueAsNumber;
  if (!(centimetres > 0 && centimetres < 200)) throw new Error("The ball’s diameter must be between 0 and 200 centimetres.");
  return { radius: centimetres / 200 };
}

function options(subject: Subject, signal: AbortSignal) {
  const common = { ball: ballOf(subject), camera: subject.camera, heatmap: true, depthMap: true, signal };
  return subject.truth ? { ...common, truth: subject.truth.world } : common;
}

function radios(name: string): NodeListOf<HTMLInputElement> {
  return document.querySelectorAll<HTMLInputElement>(`input[type="radio"][name="${name}"]`);
}

function check(name: string, value: string): void {
  for (const input of radios(name)) input.checked = input.value === value;
}
