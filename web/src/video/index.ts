/** Step 2: the ball in your own picture, video or webcam; its path through space, as plots and as files. */
import type { Vector } from "gravisight";
import { messageOf } from "../dom";
import { pictureFile } from "../shared/canvas";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, save } from "../shared/files";
import { Job, type Watch } from "../shared/job";
import type { Layer } from "../shared/maps";
import { ModelSelect } from "../shared/model-select";
import { Overlay } from "../shared/overlay";
import { Alert, fill, type Parts } from "../shared/panel";
import { View3d } from "../shared/view3d";
import { workspace } from "../shared/workspace";
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
import { SceneChoice, when } from "./scene-choice";
import { PictureSource, type Source } from "./sources";
import "./style.css";
import { listenForTimes, markContacts, playerKey } from "./timeline";
import { Transport } from "./transport";
import { VideoSource } from "./video-source";
import { Work } from "./work";

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).resume();
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
  readonly #models: ModelSelect;
  readonly #court: Court;
  readonly #work: Work;
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
    this.#plots = new Plots(part("video-plot-position"), part("video-plot-speed"), part("video-plot-pixels"), (seconds) => this.#goTo(seconds));
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
    this.#models = new ModelSelect(this.#part("video-model"), this.#part("video-model-field"));
    this.#following = new Following(
      { part, sceneChoice: this.#sceneChoice, overlay: this.#overlay, transport: this.#transport, frameSearch: this.#frameSearch, job: this.#job, models: this.#models },
      { begin: () => this.#forget(), found: ({ curve }) => this.#showCurve(curve), warn: (message) => this.#alert.say(message) },
    );
    this.#work = new Work(
      { part, sceneChoice: this.#sceneChoice, following: this.#following, frameSearch: this.#frameSearch, model: this.#model },
      {
        openVideo: (file) => this.#openFile(file),
        openWithout: ({ video }) => this.#showAbout({ ...video, kind: "video" }),
        sceneChoiceRestored: () => this.#showSceneChoice(),
      },
    );
    this.#court = new Court({ part, job: this.#job, sceneChoice: this.#sceneChoice, source: () => this.#source });
    this.#listen();
    this.#showSceneChoice();
  }

  /** Goes on with the work that this browser kept. */
  async resume(): Promise<void> {
    await this.#alert.during(() => this.#work.resume());
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
      await this.#track();
    });
    onClick("video-rally", async () => {
      await this.#openExample("Fetching the clip…", rallyExample);
      await this.#track();
    });
    onClick("video-play", () => (this.#source?.playing ? this.#source.pause() : this.#play()));
    onClick("video-stop", () => this.#close());
    onClick("video-track", () => this.#track());
    onClick("video-retrack", () => this.#following.revise().then(() => this.#kept()));
    onClick("video-calibrate", () => this.#calibrate());
    onClick("video-find", () => this.#court.find());
    onClick("video-check", () => this.#court.check());
    onClick("video-fit", () => this.#fitNow());
    onClick("video-clear", () => {
      this.#forget();
      return this.#work.forget();
    });
    onClick("video-forget-camera", () => this.#sceneChoice.forgetCamera());
    onClick("video-other-camera-forget", () => this.#sceneChoice.forgetCamera());
    onClick("video-other-camera-use", () => workspace.cameraIsOf(this.#about.name));
    onClick("video-correction-undo", () => this.#following.corrections.undo().then(() => this.#kept()));
    onClick("video-save-session", () => this.#work.save());
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
    part("video-model").addEventListener("change", () => {
      // Loaded anew, by the next choice.
      this.#model.dispose();
      void this.#alert.during(() => this.#load());
    });
    part<HTMLInputElement>("video-ball").addEventListener("change", (event) => {
      const { valueAsNumber } = event.currentTarget as HTMLInputElement;
      void this.#alert.during(async () => {
        this.#sceneChoice.setRadius(valueAsNumber / 200);
        this.#sceneChoiceChanged();
      });
    });
    part("video-overlay").addEventListener("click", (event) => void this.#alert.during(() => this.#following.corrections.click(event).then(() => this.#kept())));
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    listenForChosen(part<HTMLInputElement>("video-input"), take);
    listenForDropped(this.#panel, part("video-drop"), take);
    workspace.addEventListener("camera", () => {
      this.#sceneChoice.cameraChanged();
      this.#sceneChoiceChanged();
    });
    workspace.addEventListener("scene", () => this.#sceneChoiceChanged());
    addEventListener("hashchange", () => this.#panel.hidden && this.#source?.pause());
    document.addEventListener("keydown", (event) => !this.#panel.hidden && this.#key(event));
    listenForTimes([part("video-marks"), part("video-fit-result")], (seconds) => this.#goTo(seconds));
  }

  // Where frames come from.

  async #take(files: File[]): Promise<void> {
    const media = files.filter((file) => !isJson(file));
    if (media.length > 1) throw new Error("One video or picture at a time, please.");
    for (const file of files.filter(isJson)) if (!(await this.#work.take(file))) await this.#sceneChoice.take(file);
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
    if (source instanceof VideoSource) await this.#work.opened(file);
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
    this.#work.close();
    this.#frameSearch.open(source);
    this.#showAbout(source);
    this.#part("video-frame").querySelector("video")?.remove();
    // Under the canvas, which shows each frame together with what was found in it.
    if (source.element) this.#part("video-frame").prepend(source.element);
    this.#showSource();
    this.#sceneChoiceChanged();
    source.onFrame = (frame, missed) => {
      this.#transport.showTime(frame.timeMs);
      this.#plots.showNow(this.#frameSearch.result?.at(frame.timeMs)?.filmed ?? frame.timeMs / 1000);
      this.#frameSearch.take(frame, missed);
    };
    source.onState = () => this.#onState();
    this.#onState();
    if (source.current) source.onFrame(source.current, 0);
    await this.#load();
  }

  /** Takes down what the results are of, and makes room for them. */
  #showAbout({ name, kind, width, height, durationMs }: Pick<Source, "name" | "kind" | "width" | "height" | "durationMs">): void {
    this.#about = { name, kind, width, height, durationMs };
    this.#sceneChoice.shown = name;
    this.#forget();
    this.#part("video-empty").hidden = true;
    this.#part("video-work").hidden = false;
    this.#overlay.setSize(width, height);
  }

  async #track(): Promise<void> {
    await this.#following.start();
    await this.#kept();
  }

  /** Keeps what was found. */
  async #kept(): Promise<void> {
    const source = this.#source;
    await this.#work.found(source instanceof VideoSource ? source.file : undefined, this.#about);
  }

  /** Shows the moment that was filmed at a time, s. */
  #goTo(seconds: number): void {
    this.#source?.pause();
    this.#source?.seek(this.#frameSearch.result?.shownMs(seconds) ?? 1000 * seconds);
  }

  #key(event: KeyboardEvent): void {
    const source = this.#source;
    if (!source) return;
    const corrected = this.#following.corrections.key(event);
    if (corrected instanceof Promise) void this.#alert.during(() => corrected.then(() => this.#kept()));
    const isUsed = corrected !== false || playerKey(event, this.#panel, source, () => void (source.playing ? source.pause() : this.#play()), this.#frameSearch.result);
    if (isUsed) event.preventDefault();
  }

  /** Loads the model where camera and ball are there; without, positions have to wait. */
  #load(): Promise<void> {
    if (!this.#sceneChoice.camera || !this.#sceneChoice.scene || !this.#source || this.#model.localiser) return Promise.resolve();
    const load = async () => {
      try {
        await this.#job.run("Loading the model…", (watch: Watch) => this.#model.load(this.#models.choice, watch));
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
    workspace.calibrate({ picture, name: `a frame of ${this.#about.name}`, of: this.#about.name, sport: this.#sceneChoice.sport, back: "video" });
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
    this.#view.setBall("fit", known ? (fittedAt(this.#fit, detection.filmed)?.world ?? null) : null);
  }

  #showCounts(): void {
    const { detections, skipped, milliseconds, result } = this.#frameSearch;
    const watched = result?.record.timesMs.length ?? detections.all.length;
    this.#numbers.showCounts(watched, result?.record.missed ?? skipped, this.#frameSearch.tracked ? undefined : milliseconds, this.#about.kind === "webcam");
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
    this.#showWhether();
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
    const { camera, cameraSigma, scene } = this.#sceneChoice;
    if (!camera || !scene) throw new Error("A fit needs the camera, the place and the ball.");
    this.#source?.pause();
    const { all, version } = this.#frameSearch.detections;
    const { threshold } = this.#model;
    const fit = await this.#job.run("Fitting the trajectory…", ({ signal }) => fitted(all, { camera, cameraSigma, scene, threshold, size: this.#about, signal }));
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
    if (this.#shown) this.#view.setBall("fit", fittedAt(fit, this.#shown.filmed)?.world ?? null);
    const { result } = this.#frameSearch;
    markContacts(this.#part("video-marks"), fit.findings, (seconds) => result?.shownMs(seconds) ?? 1000 * seconds, this.#about.durationMs);
    this.#refresh();
    this.#showWhether();
  }

  #showWhether(): void {
    void this.#alert.during(() => this.#following.showWhether());
  }

  /** Forgets all positions. */
  #forget(): void {
    this.#following.end();
    this.#frameSearch.forget();
    this.#showWhether();
    this.#part("video-marks").replaceChildren();
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

  /** Another camera or scene: what was found with the last one is wrong. A track took long: it stays until it is computed again. */
  #sceneChoiceChanged(): void {
    this.#showSceneChoice();
    if (this.#part("video-work").hidden || (!this.#source && this.#sceneChoice.example)) return;
    if (this.#frameSearch.tracked) return;
    this.#forget();
    if (!this.#source) return;
    if (this.#model.localiser) this.#frameSearch.search();
    else void this.#alert.during(() => this.#load());
  }

  #showSceneChoice(): void {
    const { camera, scene, sport, summary, otherCamera } = this.#sceneChoice;
    this.#part("video-place").textContent = summary;
    this.#part("video-forget-camera").hidden = !this.#sceneChoice.canForgetCamera;
    this.#part("video-other-camera").hidden = !otherCamera;
    if (otherCamera) this.#part("video-other-camera-said").textContent = `The camera in this browser was ${otherCamera.from}, ${when(otherCamera.at)}. Use it here only if it stood in the same place with the same zoom.`;
    this.#part("video-empty-camera").hidden = camera !== undefined;
    this.#part("video-needs-camera").hidden = camera !== undefined || otherCamera !== undefined;
    void this.#alert.during(() => this.#court.showWhether());
    this.#part("video-needs-ball").hidden = camera === undefined || scene !== undefined;
    this.#part<HTMLSelectElement>("video-sport").value = sport;
    const ball = this.#part<HTMLInputElement>("video-ball");
    ball.disabled = !scene || this.#sceneChoice.example !== undefined;
    ball.value = scene ? String(Number((200 * scene.ball.radius).toFixed(2))) : "";
    this.#showWhether();
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
