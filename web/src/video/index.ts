/** Step 2: the ball in your own picture, video or webcam; its path through space, as plots and as files. */
import type { Vector } from "gravisight";
import { wordsOf } from "../dom";
import { pictureFile } from "../shared/canvas";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, save } from "../shared/files";
import { Job, type Watch } from "../shared/job";
import type { Layer } from "../shared/maps";
import { Overlay } from "../shared/overlay";
import { Alert, fill, type Parts } from "../shared/panel";
import { View3d } from "../shared/view3d";
import { workspace } from "../shared/workspace";
import { makeExample, rallyExample, realExample, type Example } from "./example";
import { fitted } from "./fit";
import { FitResult } from "./fit-result";
import { Looker } from "./looker";
import { Model } from "./model";
import { Following } from "./following";
import { Numbers } from "./numbers";
import markup from "./panel.html?raw";
import { Place } from "./place";
import { Plots } from "./plots";
import { csvOf, fittedAt, jsonOf } from "./report";
import type { Curve, Seen } from "./sightings";
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
  readonly #looker: Looker;
  readonly #place = new Place();
  readonly #model = new Model();
  /** What the positions are of; stays when the source is closed. */
  #about = { name: "", kind: "pictures" as Source["kind"], width: 1, height: 1, durationMs: 0 };
  #loading: Promise<void> | undefined;
  /** Sources that are being opened: one, or more for a moment where somebody does not wait. */
  #opening = 0;
  #fit: Curve | undefined;
  readonly #following: Following;
  /** The sightings that the fit is of. */
  #fitVersion = -1;
  /** Of what is shown now. */
  #shown: Seen | undefined;
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
    this.#looker = new Looker(
      { model: this.#model, place: this.#place, overlay: this.#overlay, job: this.#job },
      {
        shown: (seen, isFresh) => {
          this.#show(seen);
          if (isFresh) this.#refreshSoon();
        },
        counted: () => this.#showCounts(),
        failed: (thrown) => {
          if (thrown instanceof DOMException && thrown.name === "AbortError") this.#checkLayer("none");
          else this.#alert.say(wordsOf(thrown));
        },
      },
    );
    this.#following = new Following(
      { part, place: this.#place, overlay: this.#overlay, transport: this.#transport, looker: this.#looker, job: this.#job },
      { begin: () => this.#forget(), found: (curve) => this.#showCurve(curve), told: (words) => this.#alert.say(words) },
    );
    this.#listen();
    this.#showPlace();
  }

  get #source(): Source | undefined {
    return this.#looker.source;
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
    onClick("video-fit", () => this.#fitNow());
    onClick("video-clear", () => this.#forget());
    onClick("video-csv", () => save(`${this.#fileName}.csv`, csvOf(this.#looker.sightings.all, this.#fit), "text/csv"));
    onClick("video-json", () => this.#saveJson());
    onClick("video-png", async () => save(`${this.#fileName}.png`, await this.#plots.picture()));
    for (const input of this.#layers()) input.addEventListener("change", () => this.#chooseLayer(input.value as Layer));
    part<HTMLSelectElement>("video-sport").addEventListener("change", (event) => {
      const { value } = event.currentTarget as HTMLSelectElement;
      void this.#alert.during(async () => {
        await this.#place.choose(value);
        this.#placeChanged();
      });
    });
    part<HTMLInputElement>("video-ball").addEventListener("change", (event) => {
      const { valueAsNumber } = event.currentTarget as HTMLInputElement;
      void this.#alert.during(async () => {
        this.#place.setRadius(valueAsNumber / 200);
        this.#placeChanged();
      });
    });
    part("video-overlay").addEventListener("click", (event) => void this.#alert.during(() => this.#following.correct(event)));
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    listenForChosen(part<HTMLInputElement>("video-input"), take);
    listenForDropped(this.#panel, part("video-drop"), take);
    workspace.addEventListener("camera", () => {
      this.#place.cameraChanged();
      this.#placeChanged();
    });
    workspace.addEventListener("scene", () => this.#placeChanged());
    addEventListener("hashchange", () => this.#panel.hidden && this.#source?.pause());
  }

  // Where frames come from.

  async #take(files: File[]): Promise<void> {
    const media = files.filter((file) => !isJson(file));
    if (media.length > 1) throw new Error("One video or picture at a time, please.");
    for (const file of files.filter(isJson)) await this.#place.take(file);
    if (media[0]) await this.#openFile(media[0]);
    else if (files.length) this.#placeChanged();
  }

  async #openFile(file: File): Promise<void> {
    if (file.size === 0) throw new Error(`${file.name} is empty.`);
    const { source } = await this.#open(`Opening ${file.name}…`, async () => ({
      source: await (file.type.startsWith("image/") ? PictureSource.file(file) : VideoSource.file(file)),
    }));
    this.#place.example = undefined;
    await this.#use(source);
  }

  async #openWebcam(): Promise<void> {
    const { source } = await this.#open("Asking for the webcam…", async () => ({ source: await VideoSource.webcam() }));
    this.#place.example = undefined;
    await this.#use(source);
    await this.#play();
  }

  async #openExample(words: string, make: (watch: Watch) => Promise<Example>): Promise<void> {
    const { source, ...place } = await this.#open(words, make);
    this.#place.example = place;
    await this.#use(source);
  }

  /** Opens a source; meanwhile nothing can be begun with the last one. */
  async #open<T extends { source: Source }>(words: string, make: (watch: Watch) => Promise<T>): Promise<T> {
    this.#opening++;
    this.#part("video-work").inert = true;
    try {
      return await this.#job.run(words, async (watch) => {
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

  /** Takes a source in place of the last one, and looks at its first frame. */
  async #use(source: Source): Promise<void> {
    this.#close();
    const { name, kind, width, height, durationMs } = source;
    this.#about = { name, kind, width, height, durationMs };
    this.#looker.open(source);
    this.#part("video-empty").hidden = true;
    this.#part("video-work").hidden = false;
    this.#part("video-frame").querySelector("video")?.remove();
    // Under the canvas, which shows each frame together with what was found in it.
    if (source.element) this.#part("video-frame").prepend(source.element);
    this.#overlay.setSize(width, height);
    this.#showSource();
    this.#placeChanged();
    source.onFrame = (frame, missed) => {
      this.#transport.showTime(frame.timeMs);
      this.#looker.take(frame, missed);
    };
    source.onState = () => this.#onState();
    this.#onState();
    if (source.current) source.onFrame(source.current, 0);
    await this.#load();
  }

  /** Loads the model where camera and ball are there; without, positions have to wait. */
  #load(): Promise<void> {
    if (!this.#place.camera || !this.#place.scene || !this.#source || this.#model.localiser) return Promise.resolve();
    const load = async () => {
      try {
        await this.#job.run("Loading the model…", (watch: Watch) => this.#model.load(watch));
        this.#onState();
        this.#looker.look();
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
    this.#looker.open(undefined);
    this.#model.dispose();
    this.#loading = undefined;
    this.#showSource();
  }

  /** Hands the frame that is shown to the step Calibrate, which hands a camera back. */
  async #calibrate(): Promise<void> {
    const { current, width, height } = this.#source ?? {};
    if (!current || !width || !height) throw new Error("First a frame has to be there.");
    this.#source?.pause();
    const picture = await pictureFile(current.image, { width, height });
    workspace.calibrate({ picture, name: `a frame of ${this.#about.name}`, sport: this.#place.sport, back: "video" });
  }

  // What is shown.

  #show(seen: Seen | undefined): void {
    this.#shown = seen;
    if (!seen) {
      this.#numbers.clear();
      this.#numbers.showReason("The ball is not seen in this frame.");
      return;
    }
    const { flat } = this.#fit ?? { flat: !this.#place.camera || !this.#place.scene };
    const without = flat ? "Metres take a calibrated camera, and the place and the ball." : "The ball is seen, but not in a flight that physics could place: no metres here.";
    const known = seen.world !== null && seen.explained !== false;
    this.#numbers.showReason(known ? "" : seen.world ? "The flight here is not explained: where the ball is, is not known." : without);
    const isSure = seen.confidence >= this.#model.threshold;
    this.#numbers.show(seen, isSure);
    this.#view.setBall("found", isSure && known ? seen.world : null);
    this.#view.setBall("fit", known ? (fittedAt(this.#fit, seen.timeMs)?.world ?? null) : null);
  }

  #showCounts(): void {
    const { sightings, skipped, milliseconds } = this.#looker;
    const { watched = sightings.all.length, missed = skipped } = this.#following.counts ?? {};
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
    const { all, version } = this.#looker.sightings;
    const { threshold } = this.#model;
    const sure = all.filter(({ confidence }) => confidence >= threshold);
    this.#showCounts();
    this.#numbers.showMean(sure);
    const known = sure.flatMap(({ world, explained }) => (world && explained !== false ? [world] : []));
    this.#view.setPath("found", known.slice(-MOST_IN_SPACE));
    this.#plots.show(all, this.#fit, { threshold, durationMs: this.#about.durationMs });
    for (const name of ["video-csv", "video-json", "video-png", "video-clear"]) this.#part<HTMLButtonElement>(name).disabled = all.length === 0;
    this.#part<HTMLButtonElement>("video-fit").disabled = known.length < 3 || this.#looker.tracked;
    this.#fitResult.setStale(!this.#looker.tracked && this.#fit !== undefined && this.#fitVersion !== version);
  }

  #showSource(): void {
    this.#transport.open(this.#source);
    this.#following.showWhether();
    this.#part<HTMLFieldSetElement>("video-layers").disabled = !this.#source;
  }

  #onState(): void {
    this.#transport.showState();
    const playing = this.#source?.playing ?? false;
    if (playing && this.#looker.layer === "saliency") this.#checkLayer("none");
    this.#part<HTMLInputElement>("video-layer-saliency").disabled = playing;
    if (!playing) this.#looker.catchUp();
  }

  #layers(): HTMLInputElement[] {
    return [...this.#part("video-layers").querySelectorAll("input")];
  }

  #checkLayer(layer: Layer): void {
    this.#looker.layer = layer;
    for (const input of this.#layers()) input.checked = input.value === layer;
  }

  #chooseLayer(layer: Layer): void {
    this.#looker.layer = layer;
    if (!this.#source?.playing) this.#looker.look();
  }

  // What is made of it.

  async #fitNow(): Promise<void> {
    const { camera, cameraSigma, scene } = this.#place;
    if (!camera || !scene) throw new Error("A fit needs the camera, and the place and ball.");
    this.#source?.pause();
    const { all, version } = this.#looker.sightings;
    const { threshold } = this.#model;
    const fit = await this.#job.run("Fitting the trajectory…", ({ signal }) => fitted(all, { camera, cameraSigma, scene, threshold, size: this.#about, signal }));
    this.#showCurve(fit, version);
  }

  #showCurve(fit: Curve, version = this.#looker.sightings.version): void {
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
    this.#looker.forget();
    this.#fit = this.#shown = undefined;
    this.#fitResult.clear();
    this.#part("video-work").dataset.flat = "false";
    this.#numbers.clear();
    const { camera, scene } = this.#place;
    this.#view.setScene(scene ?? workspace.scene, camera);
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
    if (this.#model.localiser) this.#looker.look();
    else void this.#alert.during(() => this.#load());
  }

  #showPlace(): void {
    const { camera, scene, sport, words } = this.#place;
    this.#part("video-place").textContent = words;
    for (const name of ["video-needs-camera", "video-empty-camera"]) this.#part(name).hidden = camera !== undefined;
    this.#part("video-needs-ball").hidden = camera === undefined || scene !== undefined;
    this.#part<HTMLSelectElement>("video-sport").value = sport;
    const ball = this.#part<HTMLInputElement>("video-ball");
    ball.disabled = !scene || this.#place.example !== undefined;
    ball.value = scene ? String(Number((200 * scene.ball.radius).toFixed(2))) : "";
    this.#following.showWhether();
  }

  #saveJson(): void {
    const { camera, scene } = this.#place;
    const about = { source: this.#about.name, camera, scene, threshold: this.#model.threshold };
    save(`${this.#fileName}.json`, jsonOf(this.#looker.sightings.all, this.#fit, about));
  }

  get #fileName(): string {
    return `${this.#about.name.replace(/\.[^.]*$/, "").replace(/[^\p{L}\p{N}_-]+/gu, "-").toLowerCase() || "video"}-positions`;
  }
}
