/** Step 2: the ball in your own picture, video or webcam; its path through space, as plots and as files. */
import type { Vector } from "gravisight";
import { messageOf } from "../dom";
import { pictureFile } from "../shared/canvas";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, save } from "../shared/files";
import { Job, type Watch } from "../shared/job";
import type { Layer } from "../shared/maps";
import { Overlay } from "../shared/overlay";
import { Alert, fill, type Parts } from "../shared/panel";
import { View3d } from "../shared/view3d";
import { workspace } from "../shared/workspace";
import { Assumed } from "./assumed";
import { Court } from "./court";
import type { Curve, FrameDetection } from "./detections";
import { makeExample, rallyExample, realExample, type Example } from "./example";
import { fitted } from "./fit";
import { FitResult } from "./fit-result";
import { Following } from "./following";
import { FrameSearch } from "./frame-search";
import { Model } from "./model";
import { Numbers } from "./numbers";
import markup from "./panel.html?raw";
import { Plots } from "./plots";
import { csvOf, fittedAt, jsonOf } from "./report";
import { SceneChoice } from "./scene-choice";
import { PictureSource, type Source } from "./sources";
import "./style.css";
import { Transport } from "./transport";
import { VideoSource } from "./video-source";

export function start(panel: HTMLElement): void {
  new Step(panel);
}

/** Between two drawings of plots and space while frames come, in milliseconds. */
const REFRESH = 200;
/** Positions that the view in space shows; the last ones. */
const MOST_IN_SPACE = 2000;

class Step {
  readonly #panel: HTMLElement;
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #overlay: Overlay;
  readonly #view: View3d;
  readonly #plots: Plots;
  readonly #fitResult: FitResult;
  readonly #transport: Transport;
  readonly #numbers: Numbers;
  readonly #job: Job;
  readonly #frameSearch: FrameSearch;
  readonly #sceneChoice = new SceneChoice();
  readonly #model = new Model();
  readonly #court: Court;
  readonly #assumed: Assumed;
  /** What the positions are of; stays when the source is closed. */
  #about = { name: "", kind: "pictures" as Source["kind"], width: 1, height: 1, durationMs: 0 };
  #loading: Promise<void> | undefined;
  /** Sources that are being opened: one, or more for a moment where somebody does not wait. */
  #opening = 0;
  #fit: Curve | undefined;
  readonly #following: Following;
  /** The version of the detections that the fit is of. */
  #fitVersion = -1;
  /** Of what is shown now. */
  #shown: FrameDetection | undefined;
  #refreshing = 0;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    const part = (this.#part = fill(panel, markup));
    this.#alert = new Alert(part("video-alert"));
    this.#overlay = new Overlay(part("video-frame"), part("video-picture"), part("video-overlay"), part("video-scale"));
    this.#view = new View3d(part("video-view"));
    this.#plots = new Plots(part("video-plot-position"), part("video-plot-speed"), part("video-plot-pixels"));
    this.#fitResult = new FitResult(part("video-verdict"), part("video-fit-result"));
    this.#transport = new Transport(part);
    this.#numbers = new Numbers(part);
    this.#job = new Job(part("video-job"), "video-cancel");
    this.#frameSearch = new FrameSearch(
      { model: this.#model, sceneChoice: this.#sceneChoice, overlay: this.#overlay, job: this.#job },
      {
        shown: (detection, isFresh) => {
          this.#show(detection);
          if (isFresh) this.#refreshSoon();
        },
        counted: () => this.#showCounts(),
        failed: (thrown) => {
          if (thrown instanceof DOMException && thrown.name === "AbortError") this.#checkLayer("none");
          else this.#alert.say(messageOf(thrown));
        },
      },
    );
    this.#following = new Following(
      { part, sceneChoice: this.#sceneChoice, overlay: this.#overlay, transport: this.#transport, frameSearch: this.#frameSearch, job: this.#job },
      { begin: () => this.#forget(), found: (curve) => this.#showCurve(curve), warn: (message) => this.#alert.say(message) },
    );
    this.#court = new Court({ part, job: this.#job, sceneChoice: this.#sceneChoice, source: () => this.#source });
    this.#assumed = new Assumed({ part, job: this.#job, sceneChoice: this.#sceneChoice, source: () => this.#source });
    this.#listen();
    this.#showSceneChoice();
  }

  get #source(): Source | undefined {
    return this.#frameSearch.source;
  }

  #listen(): void {
    const part = this.#part;
    const onClick = (name: string, act: () => Promise<void> | void) =>
      part(name).addEventListener("click", () => void this.#alert.during(async () => act()));
    onClick("video-webcam", () => this.#openWebcam());
    onClick("video-example", async () => {
      await this.#openExample("Drawing a clip…", makeExample);
      await this.#play();
    });
    onClick("video-real", async () => {
      await this.#openExample("Fetching the clip…", realExample);
      await this.#following.start();
    });
    onClick("video-rally", async () => {
      await this.#openExample("Fetching the clip…", rallyExample);
      await this.#following.start();
    });
    onClick("video-play", () => (this.#source?.playing ? this.#source.pause() : this.#play()));
    onClick("video-stop", () => this.#close());
    onClick("video-track", () => this.#following.start());
    onClick("video-calibrate", () => this.#calibrate());
    onClick("video-find", () => this.#court.find());
    onClick("video-assume", async () => {
      await this.#assumed.use();
      this.#sceneChoiceChanged();
    });
    onClick("video-assume-not", () => {
      this.#assumed.forget();
      this.#sceneChoiceChanged();
    });
    onClick("video-check", () => this.#court.check());
    onClick("video-fit", () => this.#fitNow());
    onClick("video-clear", () => this.#forget());
    onClick("video-csv", () => save(`${this.#fileName}.csv`, csvOf(this.#frameSearch.detections.all, this.#fit), "text/csv"));
    onClick("video-json", () => this.#saveJson());
    onClick("video-png", async () => save(`${this.#fileName}.png`, await this.#plots.picture()));
    for (const input of this.#layers()) input.addEventListener("change", () => this.#chooseLayer(input.value as Layer));
    part<HTMLSelectElement>("video-sport").addEventListener("change", (event) => {
      const { value } = event.currentTarget as HTMLSelectElement;
      void this.#alert.during(async () => {
        await this.#sceneChoice.choose(value);
        this.#sceneChoiceChanged();
      });
    });
    part<HTMLInputElement>("video-ball").addEventListener("change", (event) => {
      const { valueAsNumber } = event.currentTarget as HTMLInputElement;
      void this.#alert.during(async () => {
        this.#sceneChoice.setRadius(valueAsNumber / 200);
        this.#sceneChoiceChanged();
      });
    });
    part("video-overlay").addEventListener("click", (event) => void this.#alert.during(() => this.#following.correct(event)));
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    listenForChosen(part<HTMLInputElement>("video-input"), take);
    listenForDropped(this.#panel, part("video-drop"), take);
    workspace.addEventListener("camera", () => {
      this.#sceneChoice.cameraChanged();
      this.#sceneChoiceChanged();
    });
    workspace.addEventListener("scene", () => this.#sceneChoiceChanged());
    addEventListener("hashchange", () => this.#panel.hidden && this.#source?.pause());
  }

  // Where frames come from.

  async #take(files: File[]): Promise<void> {
    const media = files.filter((file) => !isJson(file));
    if (media.length > 1) throw new Error("One video or picture at a time, please.");
    for (const file of files.filter(isJson)) await this.#sceneChoice.take(file);
    if (media[0]) await this.#openFile(media[0]);
    else if (files.length) this.#sceneChoiceChanged();
  }

  async #openFile(file: File): Promise<void> {
    if (file.size === 0) throw new Error(`${file.name} is empty.`);
    const { source } = await this.#open(`Opening ${file.name}…`, async () => ({
      source: await (file.type.startsWith("image/") ? PictureSource.file(file) : VideoSource.file(file)),
    }));
    this.#sceneChoice.example = undefined;
    await this.#use(source);
  }

  async #openWebcam(): Promise<void> {
    const { source } = await this.#open("Asking for the webcam…", async () => ({ source: await VideoSource.webcam() }));
    this.#sceneChoice.example = undefined;
    await this.#use(source);
    await this.#play();
  }

  async #openExample(message: string, make: (watch: Watch) => Promise<Example>): Promise<void> {
    const { source, ...example } = await this.#open(message, make);
    this.#sceneChoice.example = example;
    await this.#use(source);
  }

  /** Opens a source; meanwhile nothing can be begun with the last one. */
  async #open<T extends { source: Source }>(message: string, make: (watch: Watch) => Promise<T>): Promise<T> {
    this.#opening++;
    this.#part("video-work").inert = true;
    try {
      return await this.#job.run(message, async (watch) => {
        const opened = await make(watch);
        if (watch.signal.aborted) opened.source.dispose();
        watch.signal.throwIfAborted();
        return opened;
      });
    } finally {
      this.#opening--;
      this.#part("video-work").inert = this.#opening > 0;
    }
  }

  /** Takes a source in place of the last one, and searches its first frame. */
  async #use(source: Source): Promise<void> {
    this.#close();
    this.#court.forget();
    this.#assumed.forget();
    const { name, kind, width, height, durationMs } = source;
    this.#about = { name, kind, width, height, durationMs };
    this.#frameSearch.open(source);
    this.#part("video-empty").hidden = true;
    this.#part("video-work").hidden = false;
    this.#part("video-frame").querySelector("video")?.remove();
    // Under the canvas, which shows each frame together with what was found in it.
    if (source.element) this.#part("video-frame").prepend(source.element);
    this.#overlay.setSize(width, height);
    this.#showSource();
    this.#sceneChoiceChanged();
    source.onFrame = (frame, missed) => {
      this.#transport.showTime(frame.timeMs);
      this.#frameSearch.take(frame, missed);
    };
    source.onState = () => this.#onState();
    this.#onState();
    if (source.current) source.onFrame(source.current, 0);
    await this.#load();
  }

  /** Loads the model where camera and ball are there; without, positions have to wait. */
  #load(): Promise<void> {
    if (!this.#sceneChoice.camera || !this.#sceneChoice.scene || !this.#source || this.#model.localiser) return Promise.resolve();
    const load = async () => {
      try {
        await this.#job.run("Loading the model…", (watch: Watch) => this.#model.load(watch));
        this.#onState();
        this.#frameSearch.search();
      } finally {
        if (this.#loading === loading) this.#loading = undefined;
      }
    };
    if (this.#loading) return this.#loading;
    const loading = (this.#loading = load());
    return loading;
  }

  async #play(): Promise<void> {
    await (this.#loading ?? this.#load());
    await this.#source?.play();
  }

  /** Ends the source and the localiser; what was found stays. */
  #close(): void {
    this.#job.abort();
    this.#source?.dispose();
    this.#following.end();
    this.#frameSearch.open(undefined);
    this.#model.dispose();
    this.#loading = undefined;
    this.#showSource();
  }

  /** Hands the frame that is shown to the step Calibrate, which hands a camera back. */
  async #calibrate(): Promise<void> {
    const { current, width, height } = this.#source ?? {};
    if (!current || !width || !height) throw new Error("Open a video or a picture first.");
    this.#source?.pause();
    const picture = await pictureFile(current.image, { width, height });
    workspace.calibrate({ picture, name: `a frame of ${this.#about.name}`, sport: this.#sceneChoice.sport, back: "video" });
  }

  // What is shown.

  #show(detection: FrameDetection | undefined): void {
    this.#shown = detection;
    if (!detection) {
      this.#numbers.clear();
      this.#numbers.showReason("The ball was not found in this frame.");
      return;
    }
    const { flat } = this.#fit ?? { flat: !this.#sceneChoice.camera || !this.#sceneChoice.scene };
    const without = flat ? "Positions in metres need a calibrated camera, the place and the ball." : "The ball was found, but no flight could be fitted here: no position in metres.";
    const known = detection.world !== null && detection.explained !== false;
    this.#numbers.showReason(known ? "" : detection.world ? "The flight here is not explained: the ball’s position is unknown." : without);
    const isSure = detection.confidence >= this.#model.threshold;
    this.#numbers.show(detection, isSure);
    this.#view.setBall("found", isSure && known ? detection.world : null);
    this.#view.setBall("fit", known ? (fittedAt(this.#fit, detection.timeMs)?.world ?? null) : null);
  }

  #showCounts(): void {
    const { detections, skipped, milliseconds } = this.#frameSearch;
    const { watched = detections.all.length, missed = skipped } = this.#following.counts ?? {};
    this.#numbers.showCounts(watched, missed, milliseconds, this.#about.kind === "webcam");
  }

  #refreshSoon(): void {
    this.#refreshing ||= window.setTimeout(() => {
      this.#refreshing = 0;
      this.#refresh();
    }, REFRESH);
  }

  /** Plots, view in space, counts and buttons. */
  #refresh(): void {
    const { all, version } = this.#frameSearch.detections;
    const { threshold } = this.#model;
    const sure = all.filter(({ confidence }) => confidence >= threshold);
    this.#showCounts();
    this.#numbers.showMean(sure);
    const known = sure.flatMap(({ world, explained }) => (world && explained !== false ? [world] : []));
    this.#view.setPath("found", known.slice(-MOST_IN_SPACE));
    this.#plots.show(all, this.#fit, { threshold, durationMs: this.#about.durationMs });
    for (const name of ["video-csv", "video-json", "video-png", "video-clear"]) this.#part<HTMLButtonElement>(name).disabled = all.length === 0;
    this.#part<HTMLButtonElement>("video-fit").disabled = known.length < 3 || this.#frameSearch.tracked;
    this.#fitResult.setStale(!this.#frameSearch.tracked && this.#fit !== undefined && this.#fitVersion !== version);
  }

  #showSource(): void {
    this.#transport.open(this.#source);
    this.#following.showWhether();
    this.#part<HTMLFieldSetElement>("video-layers").disabled = !this.#source;
  }

  #onState(): void {
    this.#transport.showState();
    const playing = this.#source?.playing ?? false;
    if (playing && this.#frameSearch.layer === "saliency") this.#checkLayer("none");
    this.#part<HTMLInputElement>("video-layer-saliency").disabled = playing;
    if (!playing) this.#frameSearch.catchUp();
  }

  #layers(): HTMLInputElement[] {
    return [...this.#part("video-layers").querySelectorAll("input")];
  }

  #checkLayer(layer: Layer): void {
    this.#frameSearch.layer = layer;
    for (const input of this.#layers()) input.checked = input.value === layer;
  }

  #chooseLayer(layer: Layer): void {
    this.#frameSearch.layer = layer;
    if (!this.#source?.playing) this.#frameSearch.search();
  }

  // What is made of it.

  async #fitNow(): Promise<void> {
    const { camera, cameraSigma, cameraNote, scene } = this.#sceneChoice;
    if (!camera || !scene) throw new Error("A fit needs the camera, the place and the ball.");
    this.#source?.pause();
    const { all, version } = this.#frameSearch.detections;
    const { threshold } = this.#model;
    const fit = await this.#job.run("Fitting the trajectory…", ({ signal }) => fitted(all, { camera, cameraSigma, cameraAssumed: cameraNote !== "", scene, threshold, size: this.#about, signal }));
    this.#showCurve(fit, version);
  }

  #showCurve(fit: Curve, version = this.#frameSearch.detections.version): void {
    this.#fit = fit;
    this.#fitVersion = version;
    this.#fitResult.show(fit);
    this.#part("video-verdict").scrollIntoView({ block: "nearest" });
    this.#part("video-work").dataset.flat = String(fit.flat);
    this.#view.setPath("fit", fit.frames.flatMap(({ world, explained }) => (explained ? [world] : [])));
    this.#view.setMarks([...fit.impacts, ...fit.hits].filter(({ explained }) => explained).map(({ world }) => world));
    if (this.#shown) this.#view.setBall("fit", fittedAt(fit, this.#shown.timeMs)?.world ?? null);
    this.#refresh();
    this.#following.showWhether();
  }

  /** Forgets all positions. */
  #forget(): void {
    this.#following.end();
    this.#following.showWhether();
    this.#frameSearch.forget();
    this.#fit = this.#shown = undefined;
    this.#fitResult.clear();
    this.#part("video-work").dataset.flat = "false";
    this.#numbers.clear();
    const { camera, scene } = this.#sceneChoice;
    this.#view.setScene(scene ?? workspace.scene, camera);
    for (const name of ["found", "fit"] as const) this.#view.setBall(name, null);
    const truth = this.#source instanceof PictureSource ? this.#source.frames.flatMap((frame): Vector[] => (frame.truth ? [frame.truth] : [])) : [];
    if (truth.length) this.#view.setPath("truth", truth);
    this.#part("video-truth-key").hidden = truth.length === 0;
    this.#refresh();
  }

  /** Another camera or scene: what was found with the last one is wrong. */
  #sceneChoiceChanged(): void {
    this.#showSceneChoice();
    if (this.#part("video-work").hidden || (!this.#source && this.#sceneChoice.example)) return;
    this.#forget();
    if (!this.#source) return;
    if (this.#model.localiser) this.#frameSearch.search();
    else void this.#alert.during(() => this.#load());
  }

  #showSceneChoice(): void {
    const { camera, scene, sport, summary } = this.#sceneChoice;
    this.#part("video-place").textContent = summary;
    for (const name of ["video-needs-camera", "video-empty-camera"]) this.#part(name).hidden = camera !== undefined;
    this.#assumed.show();
    void this.#alert.during(() => this.#court.showWhether());
    this.#part("video-needs-ball").hidden = camera === undefined || scene !== undefined;
    this.#part<HTMLSelectElement>("video-sport").value = sport;
    const ball = this.#part<HTMLInputElement>("video-ball");
    ball.disabled = !scene || this.#sceneChoice.example !== undefined;
    ball.value = scene ? String(Number((200 * scene.ball.radius).toFixed(2))) : "";
    this.#following.showWhether();
  }

  #saveJson(): void {
    const { camera, scene } = this.#sceneChoice;
    const about = { source: this.#about.name, camera, scene, threshold: this.#model.threshold };
    save(`${this.#fileName}.json`, jsonOf(this.#frameSearch.detections.all, this.#fit, about));
  }

  get #fileName(): string {
    return `${this.#about.name.replace(/\.[^.]*$/, "").replace(/[^\p{L}\p{N}_-]+/gu, "-").toLowerCase() || "video"}-positions`;
  }
}
