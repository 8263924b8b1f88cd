/** Step 2: the ball in your own picture, video or webcam; its path through space, as plots and as files. */
import { messageOf } from "../dom";
import { pictureFile } from "../shared/canvas";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, otherToolsCamera } from "../shared/files";
import { Job, type Watch } from "../shared/job";
import type { Layer } from "../shared/maps";
import { ModelSelect } from "../shared/model-select";
import { Overlay } from "../shared/overlay";
import { Alert, fill, type Parts } from "../shared/panel";
import { workspace } from "../shared/workspace";
import type { Curve } from "./detections";
import { makeExample, rallyExample, realExample, type Example } from "./example";
import { fitted } from "./fit";
import { Following } from "./following";
import { FrameSearch } from "./frame-search";
import { Model } from "./model";
import markup from "./panel.html?raw";
import { WebcamRecorder } from "./recorder";
import { Results } from "./results";
import { SceneChoice } from "./scene-choice";
import { Setting } from "./setting";
import { PictureSource, type Source } from "./sources";
import "./style.css";
import { Teaching } from "./teaching";
import { playerKey } from "./timeline";
import { Transport } from "./transport";
import { VideoSource } from "./video-source";
import { Work } from "./work";

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).resume();
}

class Step {
  readonly #panel: HTMLElement;
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #overlay: Overlay;
  readonly #transport: Transport;
  readonly #job: Job;
  readonly #frameSearch: FrameSearch;
  readonly #sceneChoice = new SceneChoice();
  readonly #model = new Model();
  readonly #results: Results;
  readonly #models: ModelSelect;
  readonly #setting: Setting;
  readonly #work: Work;
  readonly #recorder: WebcamRecorder;
  readonly #teaching: Teaching;
  #loading: Promise<void> | undefined;
  /** Sources that are being opened: one, or more for a moment where somebody does not wait. */
  #opening = 0;
  readonly #following: Following;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    const part = (this.#part = fill(panel, markup));
    this.#alert = new Alert(part("video-alert"));
    this.#overlay = new Overlay(part("video-frame"), part("video-picture"), part("video-overlay"), part("video-scale"));
    this.#transport = new Transport(part);
    this.#job = new Job(part("video-job"), "video-cancel");
    this.#frameSearch = new FrameSearch(
      { model: this.#model, sceneChoice: this.#sceneChoice, overlay: this.#overlay, job: this.#job },
      {
        shown: (detection, isFresh) => {
          this.#results.show(detection);
          if (isFresh) this.#results.refreshSoon();
        },
        counted: () => this.#results.showCounts(),
        failed: (thrown) => {
          if (thrown instanceof DOMException && thrown.name === "AbortError") this.#checkLayer("none");
          else this.#alert.say(messageOf(thrown));
        },
      },
    );
    this.#results = new Results({ part, frameSearch: this.#frameSearch, sceneChoice: this.#sceneChoice, model: this.#model });
    this.#models = new ModelSelect(this.#part("video-model"), this.#part("video-model-field"));
    this.#following = new Following(
      { part, sceneChoice: this.#sceneChoice, overlay: this.#overlay, transport: this.#transport, frameSearch: this.#frameSearch, job: this.#job, models: this.#models },
      { begin: () => this.#forget(), found: ({ curve }) => this.#showCurve(curve), warn: (message) => this.#alert.say(message) },
    );
    this.#teaching = new Teaching({ part, frameSearch: this.#frameSearch, following: this.#following, job: this.#job, models: this.#models });
    this.#work = new Work(
      { part, sceneChoice: this.#sceneChoice, following: this.#following, frameSearch: this.#frameSearch, model: this.#model },
      {
        openVideo: (file) => this.#openFile(file),
        openWithout: ({ video }) => this.#showAbout({ ...video, kind: "video" }),
        sceneChoiceRestored: () => {
          this.#showSetting();
          this.#results.setScene();
        },
      },
    );
    this.#recorder = new WebcamRecorder(part, (file) => this.#openRecording(file));
    this.#setting = new Setting({ part, alert: this.#alert, job: this.#job, sceneChoice: this.#sceneChoice, source: () => this.#source }, () => this.#settingChanged());
    this.#listen();
    this.#showSetting();
  }

  /** Goes on with the work that this browser kept. */
  async resume(): Promise<void> {
    // Before the kept work, which has its own place.
    await this.#setting.takeSport();
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
    onClick("video-record", () => this.#recorder.toggle());
    onClick("video-track", () => this.#track());
    onClick("video-retrack", () => this.#following.revise().then(() => this.#kept()));
    onClick("video-calibrate", () => this.#calibrate());
    onClick("video-fit", () => this.#fitNow());
    onClick("video-clear", () => {
      this.#forget();
      return this.#work.forget();
    });
    onClick("video-correction-undo", () => this.#following.corrections.undo().then(() => this.#kept()));
    onClick("video-teach-start", () => this.#teaching.start());
    onClick("video-teach-continue", () => this.#teaching.continue());
    onClick("video-save-session", () => this.#work.save());
    onClick("video-csv", () => this.#results.saveCsv());
    onClick("video-json", () => this.#results.saveJson());
    onClick("video-png", () => this.#results.savePlots());
    onClick("video-report", () => this.#results.saveReport());
    onClick("video-film", () => this.#job.run("Drawing the video…", (watch) => this.#results.saveFilm(watch)));
    for (const input of this.#layers()) input.addEventListener("change", () => this.#chooseLayer(input.value as Layer));
    part("video-model").addEventListener("change", () => {
      // Loaded anew, by the next choice.
      this.#model.dispose();
      void this.#alert.during(() => this.#load());
    });
    part("video-overlay").addEventListener("click", (event) => void this.#alert.during(() => this.#following.corrections.click(event).then(() => this.#kept())));
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    listenForChosen(part<HTMLInputElement>("video-input"), take);
    listenForDropped(this.#panel, part("video-drop"), take);
    addEventListener("hashchange", () => this.#panel.hidden && this.#source?.pause());
    document.addEventListener("keydown", (event) => !this.#panel.hidden && this.#key(event));
  }

  // Where frames come from.

  async #take(files: File[]): Promise<void> {
    const refusal = otherToolsCamera(files);
    if (refusal) throw new Error(refusal);
    const media = files.filter((file) => !isJson(file));
    if (media.length > 1) throw new Error("One video or picture at a time, please.");
    for (const file of files.filter(isJson)) if (!(await this.#work.take(file))) await this.#sceneChoice.take(file);
    if (media[0]) await this.#openFile(media[0]);
    else if (files.length) this.#settingChanged();
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

  /** A recording's camera is the webcam's. */
  async #openRecording(file: File): Promise<void> {
    if (!this.#sceneChoice.otherCamera && workspace.cameraAbout?.of.length) workspace.cameraIsOf(file.name);
    await this.#openFile(file);
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
    this.#work.close();
    this.#setting.forget();
    this.#frameSearch.open(source);
    this.#showAbout(source);
    this.#part("video-frame").querySelector("video")?.remove();
    // Under the canvas, which shows each frame together with what was found in it.
    if (source.element) this.#part("video-frame").prepend(source.element);
    this.#showSource();
    this.#settingChanged();
    source.onFrame = (frame, missed) => {
      this.#transport.showTime(frame.timeMs);
      this.#results.showTime(frame.timeMs);
      this.#frameSearch.take(frame, missed);
    };
    source.onState = () => this.#onState();
    this.#onState();
    if (source.current) source.onFrame(source.current, 0);
    await this.#load();
  }

  /** Takes down what the results are of, and makes room for them. */
  #showAbout({ name, kind, width, height, durationMs }: Pick<Source, "name" | "kind" | "width" | "height" | "durationMs">): void {
    this.#results.about = { name, kind, width, height, durationMs };
    this.#sceneChoice.shown = name;
    this.#forget();
    this.#part("video-empty").hidden = true;
    this.#part("video-work").hidden = false;
    this.#overlay.setSize(width, height);
  }

  async #track(): Promise<void> {
    // Whoever is quick means the place that was just chosen.
    await this.#setting.settled;
    await this.#following.start();
    await this.#kept();
  }

  /** Keeps what was found. */
  async #kept(): Promise<void> {
    const source = this.#source;
    await this.#work.found(source instanceof VideoSource ? source.file : undefined, this.#results.about);
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
    workspace.calibrate({ picture, name: `a frame of ${this.#results.about.name}`, of: this.#results.about.name, sport: this.#sceneChoice.sport, back: "video" });
  }

  // What is shown.

  #showSource(): void {
    this.#transport.open(this.#source);
    this.#recorder.open(this.#source instanceof VideoSource && this.#source.stream ? this.#source : undefined);
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
    const { camera, cameraSigma, cameraNote, scene } = this.#sceneChoice;
    if (!camera || !scene) throw new Error("A fit needs the camera, the place and the ball.");
    this.#source?.pause();
    const { all, version } = this.#frameSearch.detections;
    const { threshold } = this.#model;
    const fit = await this.#job.run("Fitting the trajectory…", ({ signal }) => fitted(all, { camera, cameraSigma, cameraAssumed: cameraNote !== "", scene, threshold, size: this.#results.about, signal }));
    this.#showCurve(fit, version);
  }

  #showCurve(fit: Curve, version?: number): void {
    this.#results.showCurve(fit, version);
    this.#showWhether();
  }

  #showWhether(): void {
    void this.#alert.during(async () => {
      await this.#following.showWhether();
      await this.#teaching.showWhether();
    });
  }

  /** Forgets all positions. */
  #forget(): void {
    this.#following.end();
    this.#frameSearch.forget();
    this.#showWhether();
    this.#results.clear();
  }

  /** Another camera or scene: what was found with the last one is wrong. A track took long: it stays until it is computed again. */
  #settingChanged(): void {
    this.#showSetting();
    if (this.#part("video-work").hidden || (!this.#source && this.#sceneChoice.example)) return;
    if (this.#frameSearch.tracked) return;
    this.#forget();
    if (!this.#source) return;
    if (this.#model.localiser) this.#frameSearch.search();
    else void this.#alert.during(() => this.#load());
  }

  #showSetting(): void {
    this.#setting.show();
    this.#showWhether();
  }
}
