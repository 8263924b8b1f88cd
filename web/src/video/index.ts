/** Step 2: the ball in your own picture, video or webcam; its path through space, as plots and as files. */
import { GravisightError, Track, type LocaliseOptions, type Progress, type Trajectory, type Vector } from "gravisight";
import { wordsOf } from "../dom";
import { tools } from "../shared/core";
import { Alert, fill } from "../shared/panel";
import { save } from "../shared/save";
import { View3d } from "../shared/view3d";
import { workspace } from "../shared/workspace";
import { makeExample } from "./example";
import { FitResult } from "./fit-result";
import { Model } from "./model";
import { Overlay, type Layer } from "./overlay";
import markup from "./panel.html?raw";
import { Place } from "./place";
import { Plots } from "./plots";
import { csvOf, fittedAt, jsonOf } from "./report";
import { Sightings, type Seen } from "./sightings";
import { PictureSource, VideoSource, type Frame, type Source } from "./sources";
import "./style.css";

export function start(panel: HTMLElement): void {
  new Step(panel);
}

/** Between two drawings of plots and space while frames come, in milliseconds. */
const REFRESH = 200;
/** Frames that the time a frame is averaged over. */
const AVERAGED = 30;
/** So many frames in a row that cannot be read are an error. */
const MOST_UNREADABLE = 30;
/** Positions that the view in space shows; the last ones. */
const MOST_IN_SPACE = 2000;

class Step {
  readonly #panel: HTMLElement;
  readonly #part: ReturnType<typeof fill>;
  readonly #alert: Alert;
  readonly #overlay: Overlay;
  readonly #view: View3d;
  readonly #plots: Plots;
  readonly #fitResult: FitResult;
  readonly #place = new Place();
  readonly #model = new Model();
  readonly #sightings = new Sightings();
  #source: Source | undefined;
  /** What the positions are of; stays when the source is closed. */
  #about = { name: "", kind: "pictures" as Source["kind"], width: 1, height: 1, durationMs: 0 };
  #job: AbortController | undefined;
  #loading: Promise<void> | undefined;
  #fit: Trajectory | undefined;
  /** The sightings that the fit is of. */
  #fitVersion = -1;
  #layer: Layer = "none";
  #busy = false;
  /** Of what is shown now. */
  #shown: Seen | undefined;
  #lastStamp = -Infinity;
  /** Frames in a row that could not be read. */
  #unreadable = 0;
  #skipped = 0;
  #times: number[] = [];
  #refreshing = 0;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    const part = (this.#part = fill(panel, markup));
    this.#alert = new Alert(part("video-alert"));
    this.#overlay = new Overlay(part("video-frame"), part("video-picture"), part("video-overlay"), part("video-scale"));
    this.#view = new View3d(part("video-view"));
    this.#plots = new Plots(part("video-plot-position"), part("video-plot-speed"));
    this.#fitResult = new FitResult(part("video-fit-result"));
    this.#listen();
    this.#showPlace();
  }

  #listen(): void {
    const part = this.#part;
    const onClick = (testId: string, act: () => Promise<void> | void) =>
      part<HTMLButtonElement>(testId).addEventListener("click", () => void this.#alert.during(async () => act()));
    onClick("video-webcam", () => this.#openWebcam());
    onClick("video-example", () => this.#openExample());
    onClick("video-cancel", () => this.#job?.abort());
    onClick("video-play", () => (this.#source?.playing ? this.#source.pause() : this.#play()));
    onClick("video-back", () => this.#source?.step(-1));
    onClick("video-forward", () => this.#source?.step(1));
    onClick("video-stop", () => this.#close());
    onClick("video-fit", () => this.#fitNow());
    onClick("video-clear", () => this.#forget());
    onClick("video-csv", () => save(`${this.#fileName}.csv`, csvOf(this.#sightings.all, this.#fit), "text/csv"));
    onClick("video-json", () => this.#saveJson());
    onClick("video-png", async () => save(`${this.#fileName}.png`, await this.#plots.picture()));
    const time = part<HTMLInputElement>("video-time");
    time.addEventListener("input", () => this.#source?.seek(Number(time.value)));
    const rate = part<HTMLSelectElement>("video-rate");
    rate.addEventListener("change", () => this.#source?.setRate(Number(rate.value)));
    for (const input of this.#layers()) input.addEventListener("change", () => this.#chooseLayer(input.value as Layer));
    const input = part<HTMLInputElement>("video-input");
    input.addEventListener("change", () => {
      const files = [...(input.files ?? [])];
      // So that choosing the same file again is a change.
      input.value = "";
      void this.#alert.during(() => this.#take(files));
    });
    this.#listenForDrops();
    workspace.addEventListener("camera", () => this.#placeChanged());
    workspace.addEventListener("scene", () => this.#placeChanged());
    addEventListener("hashchange", () => this.#panel.hidden && this.#source?.pause());
  }

  /** The whole page takes drops while this step is shown: ahead of the step Try, which listens on the document, too. */
  #listenForDrops(): void {
    const zone = this.#part("video-drop");
    const mine = (act: (event: DragEvent) => void) => (event: DragEvent) => {
      if (this.#panel.hidden) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      act(event);
    };
    document.addEventListener("dragover", mine(() => zone.classList.add("over")), { capture: true });
    document.addEventListener("dragleave", mine((event) => !event.relatedTarget && zone.classList.remove("over")), { capture: true });
    const onDrop = mine((event) => {
      zone.classList.remove("over");
      void this.#alert.during(() => this.#take([...(event.dataTransfer?.files ?? [])]));
    });
    document.addEventListener("drop", onDrop, { capture: true });
  }

  async #take(files: File[]): Promise<void> {
    const isJson = (file: File) => file.type === "application/json" || file.name.toLowerCase().endsWith(".json");
    const media = files.filter((file) => !isJson(file));
    if (media.length > 1) throw new Error("One video or picture at a time, please.");
    for (const file of files.filter(isJson)) {
      const what = await this.#place.take(file);
      await this.#check(what);
    }
    if (media[0]) await this.#openFile(media[0]);
    else if (files.length) this.#placeChanged();
  }

  /** Lets the core look at a dropped camera or scene before it is used. */
  async #check(what: "camera" | "scene"): Promise<void> {
    const { camera, scene } = this.#place;
    try {
      const toolbox = await tools();
      if (what === "camera" && camera) await toolbox.project(camera, [[0, 0, 0]]);
      if (what === "scene") await toolbox.forecast(scene, { position: [0, 0, 1e3], velocity: [0, 0, 0] }, [0]);
    } catch (thrown) {
      this.#place.forget(what);
      this.#showPlace();
      throw thrown;
    }
  }

  async #openFile(file: File): Promise<void> {
    if (file.size === 0) throw new Error(`${file.name} is empty.`);
    const source = await this.#during(`Opening ${file.name}…`, async () => (file.type.startsWith("image/") ? pictureSource(file) : VideoSource.file(file)));
    this.#place.example = undefined;
    await this.#use(source);
  }

  async #openWebcam(): Promise<void> {
    const source = await this.#during("Asking for the webcam…", async (signal) => {
      const opened = await VideoSource.webcam();
      if (signal.aborted) opened.dispose();
      signal.throwIfAborted();
      return opened;
    });
    this.#place.example = undefined;
    await this.#use(source);
    await this.#play();
  }

  async #openExample(): Promise<void> {
    const { source, camera, scene } = await this.#during("Drawing a clip…", (signal, progress) => makeExample(signal, progress));
    this.#place.example = { camera, scene };
    await this.#use(source);
    await this.#play();
  }

  /** Takes a source in place of the last one, and looks at its first frame. */
  async #use(source: Source): Promise<void> {
    this.#close();
    this.#source = source;
    const { name, kind, width, height, durationMs } = source;
    this.#about = { name, kind, width, height, durationMs };
    this.#part("video-empty").hidden = true;
    this.#part("video-work").hidden = false;
    this.#part("video-frame").querySelector("video")?.remove();
    // Under the canvas, which shows each frame together with what was found in it.
    if (source.element) this.#part("video-frame").prepend(source.element);
    this.#overlay.setSize(width, height);
    this.#showControls();
    this.#placeChanged();
    source.setRate(Number(this.#part<HTMLSelectElement>("video-rate").value));
    source.onFrame = (frame, missed) => this.#onFrame(frame, missed);
    source.onState = () => this.#onState();
    this.#onState();
    if (source.current) this.#onFrame(source.current, 0);
    await this.#load();
  }

  /** Loads the model where a camera is there; without, positions have to wait. */
  #load(): Promise<void> {
    if (!this.#place.camera || !this.#source || this.#model.localiser) return Promise.resolve();
    const load = async () => {
      try {
        await this.#during("Loading the model…", (signal, progress) => this.#model.load(signal, (now) => progress(...amount(now))));
        this.#lastStamp = -Infinity;
        if (this.#source?.current) this.#onFrame(this.#source.current, 0);
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
    this.#job?.abort();
    this.#source?.dispose();
    this.#source = undefined;
    this.#model.dispose();
    this.#loading = undefined;
    this.#busy = false;
    if (!this.#part("video-work").hidden) this.#showControls();
    this.#onState();
  }

  /** A long job: shown, with a way to stop it. One at a time. */
  async #during<T>(words: string, work: (signal: AbortSignal, progress: (done: number, of: number | null) => void) => Promise<T>): Promise<T> {
    this.#job?.abort();
    const job = (this.#job = new AbortController());
    const bar = this.#part<HTMLProgressElement>("video-progress");
    bar.removeAttribute("value");
    this.#part("video-job-words").textContent = words;
    this.#part("video-job").hidden = false;
    const stopped = new Promise<never>((_, reject) => {
      job.signal.addEventListener("abort", () => reject(job.signal.reason as Error));
    });
    try {
      const progress = (done: number, of: number | null) => {
        if (this.#job === job && of) bar.value = done / of;
      };
      return await Promise.race([work(job.signal, progress), stopped]);
    } finally {
      if (this.#job === job) {
        this.#job = undefined;
        this.#part("video-job").hidden = true;
      }
    }
  }

  #onFrame(frame: Frame, missed: number): void {
    const source = this.#source;
    if (!source) return;
    this.#showTime(frame.timeMs);
    const localiser = this.#model.localiser;
    if (!localiser || !this.#place.camera) {
      this.#overlay.showPlain(frame.image, "A frame without a position");
      return;
    }
    const known = this.#sightings.at(frame.timeMs);
    const isNew = frame.timeMs > (this.#sightings.all.at(-1)?.timeMs ?? -Infinity);
    if (source.playing && isNew) this.#skipped += missed;
    if (known && this.#layer === "none" && !this.#busy) {
      this.#overlay.hold(frame.image);
      this.#show(known);
    } else if (!this.#busy) {
      void this.#look(frame, isNew);
    } else if (source.playing && isNew) {
      this.#skipped++;
    }
    this.#showCounts();
  }

  async #look(frame: Frame, isNew: boolean): Promise<void> {
    const source = this.#source;
    const localiser = this.#model.localiser;
    const { camera } = this.#place;
    if (!source || !localiser || !camera) return;
    this.#busy = true;
    const layer = this.#layer === "saliency" && source.playing ? "none" : this.#layer;
    const options: LocaliseOptions = { camera, heatmap: layer === "heatmap", depthMap: layer === "depth", ...(frame.truth && { truth: frame.truth }) };
    try {
      this.#overlay.hold(frame.image);
      const find = (more: LocaliseOptions = {}) => {
        const all = { ...options, ...more };
        if (!(frame.timeMs > this.#lastStamp)) return localiser.localise(frame.picture, all);
        this.#lastStamp = frame.timeMs;
        return localiser.localiseVideoFrame(frame.picture, frame.timeMs, all);
      };
      const found = await (layer === "saliency"
        ? this.#during("Looking for what the depth depends on…", (signal) => find({ saliency: true, signal }))
        : find());
      if (this.#source !== source) return;
      this.#unreadable = 0;
      if (!isNew && !this.#sightings.at(frame.timeMs)) this.#skipped = Math.max(0, this.#skipped - 1);
      this.#times = [...this.#times, found.milliseconds].slice(-AVERAGED);
      const seen = this.#sightings.add(frame.timeMs, found, frame.truth);
      this.#show(seen, { ...found, ...seen }, layer);
      this.#refreshSoon();
    } catch (thrown) {
      if (this.#source !== source) return;
      // Browsers may give no pixels of a video just when it starts or changes; the next frame has some.
      if ((source.playing || source.kind === "webcam") && codeOf(thrown) === "image-read" && ++this.#unreadable < MOST_UNREADABLE) {
        this.#skipped++;
        return;
      }
      source.pause();
      this.#overlay.showPlain(frame.image, "A frame without a position");
      if (thrown instanceof DOMException && thrown.name === "AbortError") this.#checkLayer("none");
      else this.#alert.say(wordsOf(thrown));
      // Or it would be tried for ever.
      return;
    } finally {
      if (this.#source === source) this.#busy = false;
    }
    // Somebody has gone on to another frame meanwhile.
    const now = source.current;
    if (!source.playing && now && now.timeMs !== frame.timeMs) this.#onFrame(now, 0);
  }

  #show(seen: Seen, found: Parameters<Overlay["show"]>[0] = seen, layer: Layer = "none"): void {
    this.#shown = seen;
    this.#overlay.show(found, this.#model.threshold, layer);
    const metres = (testId: string, value: number) => this.#data(testId, value, value.toFixed(2).replace("-", "−"));
    const [x, y, z] = seen.world;
    metres("video-x", x);
    metres("video-y", y);
    metres("video-z", z);
    const sure = seen.confidence >= this.#model.threshold;
    this.#data("video-confidence", seen.confidence, `${(100 * seen.confidence).toFixed(0)} %${sure ? "" : " – not sure"}`);
    this.#part("video-error-row").hidden = seen.dtg === undefined;
    if (seen.dtg !== undefined) this.#data("video-error", seen.dtg, `${(100 * seen.dtg).toFixed(1)} cm`);
    this.#view.setBall("found", sure ? seen.world : null);
    this.#view.setBall("fit", fittedAt(this.#fit, seen.timeMs)?.world ?? null);
  }

  #showCounts(): void {
    const { all } = this.#sightings;
    this.#data("video-processed", all.length, String(all.length));
    this.#data("video-skipped", this.#skipped, String(this.#skipped));
    this.#part("video-skipped-note").hidden = this.#skipped === 0 || this.#about.kind === "webcam";
    const mean = average(this.#times);
    this.#data("video-ms", mean ?? "", mean === undefined ? "–" : `${mean.toFixed(1)} ms`);
  }

  #refreshSoon(): void {
    this.#refreshing ||= window.setTimeout(() => {
      this.#refreshing = 0;
      this.#refresh();
    }, REFRESH);
  }

  /** Plots, view in space, counts and buttons. */
  #refresh(): void {
    const { all } = this.#sightings;
    const sure = this.#sure();
    this.#showCounts();
    const errors = sure.flatMap(({ dtg }) => dtg ?? []);
    const mean = average(errors);
    this.#part("video-mean-row").hidden = mean === undefined;
    if (mean !== undefined) this.#data("video-mean-error", mean, `${(100 * mean).toFixed(1)} cm`);
    this.#view.setPath("found", sure.slice(-MOST_IN_SPACE).map(({ world }) => world));
    this.#plots.show(all, this.#fit, { threshold: this.#model.threshold, durationMs: this.#about.durationMs });
    for (const testId of ["video-csv", "video-json", "video-png", "video-clear"]) this.#part<HTMLButtonElement>(testId).disabled = all.length === 0;
    this.#part<HTMLButtonElement>("video-fit").disabled = sure.length < 3;
    this.#fitResult.setStale(this.#fit !== undefined && this.#fitVersion !== this.#sightings.version);
  }

  #sure(): Seen[] {
    return this.#sightings.all.filter(({ confidence }) => confidence >= this.#model.threshold);
  }

  async #fitNow(): Promise<void> {
    const { camera, scene } = this.#place;
    if (!camera) throw new Error("A fit needs the camera.");
    this.#source?.pause();
    const { version } = this.#sightings;
    const { width, height } = this.#about;
    const fit = await this.#during("Fitting the trajectory…", async (signal) => {
      const track = await Track.create({ camera, scene, toolbox: await tools(), leastConfidence: this.#model.threshold });
      for (const { timeMs, image: [u, v], confidence } of this.#sightings.all) {
        // In the pixels that the camera speaks of, which need not be the video's; an integer is a pixel's centre.
        const image: [number, number] = [((u + 0.5) * camera.width) / width - 0.5, ((v + 0.5) * camera.height) / height - 0.5];
        track.add({ timestampMs: timeMs, image, confidence });
      }
      return track.fit({ signal }).catch((thrown: unknown) => {
        if (codeOf(thrown) !== "fit") throw thrown;
        throw new Error(`The trajectory could not be fitted: ${wordsOf(thrown).replace(/^fit: /, "")}.`);
      });
    });
    this.#fit = fit;
    this.#fitVersion = version;
    this.#fitResult.show(fit);
    this.#view.setPath("fit", fit.points.map(({ world }) => world));
    this.#view.setMarks(fit.bounces.map(({ world }) => world));
    if (this.#shown) this.#view.setBall("fit", fittedAt(fit, this.#shown.timeMs)?.world ?? null);
    this.#refresh();
  }

  /** Forgets all positions. */
  #forget(): void {
    this.#sightings.clear();
    this.#fit = this.#shown = undefined;
    this.#fitResult.clear();
    this.#skipped = 0;
    this.#times = [];
    for (const testId of ["video-x", "video-y", "video-z", "video-confidence", "video-error", "video-mean-error"]) this.#data(testId, "", "–");
    for (const testId of ["video-error-row", "video-mean-row"]) this.#part(testId).hidden = true;
    this.#overlay.clear("No position yet");
    const { camera, scene } = this.#place;
    this.#view.setScene(scene, camera);
    for (const name of ["found", "fit"] as const) this.#view.setBall(name, null);
    const truth = this.#source instanceof PictureSource ? this.#source.frames.flatMap((frame): Vector[] => (frame.truth ? [frame.truth] : [])) : [];
    if (truth.length) this.#view.setPath("truth", truth);
    this.#part("video-truth-key").hidden = truth.length === 0;
    this.#refresh();
  }

  /** Another camera or scene: what was found with the last one is wrong. */
  #placeChanged(): void {
    this.#showPlace();
    if (this.#part("video-work").hidden || (!this.#source && this.#place.example)) return;
    this.#forget();
    if (!this.#source) return;
    const { current } = this.#source;
    if (this.#model.localiser && current) this.#onFrame(current, 0);
    else void this.#alert.during(() => this.#load());
  }

  #showPlace(): void {
    this.#part("video-place").textContent = this.#place.words;
    for (const testId of ["video-needs-camera", "video-empty-camera"]) this.#part(testId).hidden = this.#place.camera !== undefined;
  }

  #showControls(): void {
    const source = this.#source;
    const live = source?.kind === "webcam";
    this.#part("video-transport").hidden = !source || !(source.durationMs > 0);
    this.#part("video-stop").hidden = !source;
    const moves = source !== undefined && source.durationMs > 0;
    for (const testId of ["video-play", "video-clock"]) this.#part(testId).hidden = !moves;
    for (const testId of ["video-back", "video-forward", "video-time"]) this.#part(testId).hidden = !moves || live;
    this.#part<HTMLSelectElement>("video-rate").parentElement!.hidden = !moves || live;
    this.#part("video-stop").textContent = live ? "Stop the webcam" : "Close";
    this.#part<HTMLFieldSetElement>("video-layers").disabled = !source;
    this.#part<HTMLInputElement>("video-time").max = String(live ? 0 : (source?.durationMs ?? 0));
  }

  #onState(): void {
    const playing = this.#source?.playing ?? false;
    const button = this.#part("video-play");
    button.dataset.playing = String(playing);
    button.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (playing && this.#layer === "saliency") this.#checkLayer("none");
    this.#part<HTMLInputElement>("video-layer-saliency").disabled = playing;
    // The last frame may have come while another was looked at.
    const current = this.#source?.current;
    if (!playing && current && !this.#busy && !this.#sightings.at(current.timeMs)) this.#onFrame(current, 0);
  }

  #showTime(timeMs: number): void {
    const words = `${(timeMs / 1000).toFixed(2)} s`;
    const time = this.#part<HTMLInputElement>("video-time");
    time.value = String(timeMs);
    time.setAttribute("aria-valuetext", words);
    this.#part("video-clock").textContent = words;
  }

  #layers(): HTMLInputElement[] {
    return [...this.#part("video-layers").querySelectorAll("input")];
  }

  #checkLayer(layer: Layer): void {
    this.#layer = layer;
    for (const input of this.#layers()) input.checked = input.value === layer;
  }

  #chooseLayer(layer: Layer): void {
    this.#layer = layer;
    const current = this.#source?.current;
    if (current && !this.#source?.playing) this.#onFrame(current, 0);
  }

  #saveJson(): void {
    const { camera, scene } = this.#place;
    const about = { source: this.#about.name, camera, scene, threshold: this.#model.threshold };
    save(`${this.#fileName}.json`, jsonOf(this.#sightings.all, this.#fit, about));
  }

  get #fileName(): string {
    return `${this.#about.name.replace(/\.[^.]*$/, "").replace(/[^\p{L}\p{N}_-]+/gu, "-").toLowerCase() || "video"}-positions`;
  }

  #data(testId: string, value: number | string, words: string): void {
    const data = this.#part<HTMLDataElement>(testId);
    data.value = String(value);
    data.textContent = words;
  }
}

async function pictureSource(file: File): Promise<PictureSource> {
  const image = await createImageBitmap(file).catch(() => {
    throw new Error(`${file.name} is no picture that this browser can read.`);
  });
  return new PictureSource(file.name, image.width, image.height, [{ picture: file, image, timeMs: 0 }]);
}

function codeOf(thrown: unknown): string | undefined {
  return thrown instanceof GravisightError ? thrown.code : undefined;
}

function average(values: number[]): number | undefined {
  return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : undefined;
}

function amount({ stage, loaded, total }: Progress): [number, number | null] {
  return [loaded, stage === "weights" ? total : null];
}
