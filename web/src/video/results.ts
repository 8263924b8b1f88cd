/** All that is shown and saved of what was found: numbers, verdict, plots, the view in space, marks on the slider. */
import type { Vector } from "gravisight";
import { save } from "../shared/files";
import type { Watch } from "../shared/job";
import type { Parts } from "../shared/panel";
import { View3d } from "../shared/view3d";
import { workspace } from "../shared/workspace";
import type { Curve, FrameDetection } from "./detections";
import { FitResult } from "./fit-result";
import type { FrameSearch } from "./frame-search";
import type { Model } from "./model";
import { Numbers } from "./numbers";
import { Plots } from "./plots";
import { csvOf, fittedAt, jsonOf } from "./report";
import type { SceneChoice } from "./scene-choice";
import { PictureSource, type Source } from "./sources";
import { listenForTimes, markContacts } from "./timeline";
import { keepUnits, keptUnits, unitsOf } from "./units";
import { VideoSource } from "./video-source";

/** Between two drawings of plots and space while frames come, in milliseconds. */
const REFRESH = 200;
/** Positions that the view in space shows; the last ones. */
const MOST_IN_SPACE = 2000;
/** What can be saved once something was found. */
const SAVES = ["video-csv", "video-json", "video-png", "video-report", "video-clear"];

interface With {
  part: Parts;
  frameSearch: FrameSearch;
  sceneChoice: SceneChoice;
  model: Model;
}

export class Results {
  /** What the positions are of; stays when the source is closed. */
  about = { name: "", kind: "pictures" as Source["kind"], width: 1, height: 1, durationMs: 0 };
  readonly #with: With;
  readonly #part: Parts;
  readonly #view: View3d;
  readonly #plots: Plots;
  readonly #fitResult: FitResult;
  readonly #numbers: Numbers;
  #fit: Curve | undefined;
  /** The version of the detections that the fit is of. */
  #fitVersion = -1;
  /** Of what is shown now. */
  #shown: FrameDetection | undefined;
  #refreshing = 0;
  #units = unitsOf(keptUnits());

  constructor(uses: With) {
    const { part } = uses;
    this.#with = uses;
    this.#part = part;
    this.#view = new View3d(part("video-view"));
    this.#plots = new Plots(part("video-plot-position"), part("video-plot-speed"), part("video-plot-pixels"), (seconds) => this.#goTo(seconds));
    this.#fitResult = new FitResult(part("video-verdict"), part("video-fit-result"), this.#units);
    this.#numbers = new Numbers(part, this.#units);
    const choice = part<HTMLSelectElement>("video-units");
    choice.value = keptUnits();
    choice.addEventListener("change", () => this.#use(choice.value));
    this.#nameUnits();
    listenForTimes([part("video-marks"), part("video-fit-result")], (seconds) => this.#goTo(seconds));
  }

  get #source(): Source | undefined {
    return this.#with.frameSearch.source;
  }

  /** Shows what was found in the frame that is on the screen. */
  show(detection: FrameDetection | undefined): void {
    const { sceneChoice, model } = this.#with;
    this.#shown = detection;
    if (!detection) {
      this.#numbers.clear();
      this.#numbers.showReason("The ball was not found in this frame.");
      return;
    }
    const { flat } = this.#fit ?? { flat: !sceneChoice.camera || !sceneChoice.scene };
    const without = flat ? "Positions in metres need a calibrated camera, the place and the ball." : "The ball was found, but no flight fits here: its position in metres is unknown.";
    const known = detection.world !== null && detection.explained !== false;
    this.#numbers.showReason(known ? "" : detection.world ? "Physics does not explain the flight here: the ball’s position is unknown." : without);
    const isSure = detection.confidence >= model.threshold;
    this.#numbers.show(detection, isSure);
    this.#view.setBall("found", isSure && known ? detection.world : null);
    this.#view.setBall("fit", known ? (fittedAt(this.#fit, detection.filmed)?.world ?? null) : null);
  }

  /** Shows all numbers in other units. */
  #use(name: string): void {
    keepUnits(name);
    this.#units = this.#numbers.units = this.#fitResult.units = unitsOf(name);
    this.#nameUnits();
    if (this.#fit) this.#fitResult.show(this.#fit);
    if (this.#shown) this.show(this.#shown);
    this.refresh();
  }

  #nameUnits(): void {
    this.#part("video-position-title").textContent = `Position in this frame, ${this.#units.length.name}`;
  }

  /** Marks the moment that the video shows. */
  showTime(timeMs: number): void {
    this.#plots.showNow(this.#with.frameSearch.result?.at(timeMs)?.filmed ?? timeMs / 1000);
  }

  showCounts(): void {
    const { detections, skipped, milliseconds, result, tracked } = this.#with.frameSearch;
    const watched = result?.record.timesMs.length ?? detections.all.length;
    this.#numbers.showCounts(watched, result?.record.missed ?? skipped, tracked ? undefined : milliseconds, this.about.kind === "webcam");
  }

  refreshSoon(): void {
    this.#refreshing ||= window.setTimeout(() => {
      this.#refreshing = 0;
      this.refresh();
    }, REFRESH);
  }

  /** Plots, view in space, counts and buttons. */
  refresh(): void {
    const { detections, tracked, result } = this.#with.frameSearch;
    const { all, version } = detections;
    const { threshold } = this.#with.model;
    const sure = all.filter(({ confidence }) => confidence >= threshold);
    this.showCounts();
    this.#numbers.showMean(sure);
    const known = sure.flatMap(({ world, explained }) => (world && explained !== false ? [world] : []));
    this.#view.setPath("found", known.slice(-MOST_IN_SPACE));
    this.#plots.show(all, this.#fit, { threshold, durationMs: this.about.durationMs, units: this.#units });
    for (const name of SAVES) this.#part<HTMLButtonElement>(name).disabled = all.length === 0;
    this.#part<HTMLButtonElement>("video-film").disabled = !result || !(this.#source instanceof VideoSource);
    this.#part<HTMLButtonElement>("video-fit").disabled = known.length < 3 || tracked;
    this.#fitResult.setStale(!tracked && this.#fit !== undefined && this.#fitVersion !== version);
  }

  showCurve(fit: Curve, version = this.#with.frameSearch.detections.version): void {
    this.#fit = fit;
    this.#fitVersion = version;
    this.#fitResult.show(fit);
    this.#part("video-verdict").scrollIntoView({ block: "nearest" });
    this.#part("video-work").dataset.flat = String(fit.flat);
    this.#view.setPath("fit", fit.frames.flatMap(({ world, explained }) => (explained ? [world] : [])));
    this.#view.setMarks([...fit.impacts, ...fit.hits].filter(({ explained }) => explained).map(({ world }) => world));
    if (this.#shown) this.#view.setBall("fit", fittedAt(fit, this.#shown.filmed)?.world ?? null);
    markContacts(this.#part("video-marks"), fit.findings, (seconds) => this.#shownMs(seconds), this.about.durationMs);
    this.refresh();
  }

  /** Takes the camera and the place that are chosen now. */
  setScene(): void {
    const { camera, scene } = this.#with.sceneChoice;
    this.#view.setScene(scene ?? workspace.scene, camera);
  }

  clear(): void {
    this.#part("video-marks").replaceChildren();
    this.#fit = this.#shown = undefined;
    this.#fitResult.clear();
    this.#part("video-work").dataset.flat = "false";
    this.#numbers.clear();
    this.setScene();
    for (const name of ["found", "fit"] as const) this.#view.setBall(name, null);
    const truth = this.#source instanceof PictureSource ? this.#source.frames.flatMap((frame): Vector[] => (frame.truth ? [frame.truth] : [])) : [];
    if (truth.length) this.#view.setPath("truth", truth);
    this.#part("video-truth-key").hidden = truth.length === 0;
    this.refresh();
  }

  #shownMs(seconds: number): number {
    return this.#with.frameSearch.result?.shownMs(seconds) ?? 1000 * seconds;
  }

  /** Shows the moment that was filmed at a time, s. */
  #goTo(seconds: number): void {
    this.#source?.pause();
    this.#source?.seek(this.#shownMs(seconds));
  }

  // Files.

  saveCsv(): void {
    save(`${this.fileName}.csv`, csvOf(this.#with.frameSearch.detections.all, this.#fit), "text/csv");
  }

  saveJson(): void {
    const { sceneChoice, model, frameSearch } = this.#with;
    const { camera, scene } = sceneChoice;
    const about = { source: this.about.name, camera, scene, threshold: model.threshold };
    save(`${this.fileName}.json`, jsonOf(frameSearch.detections.all, this.#fit, about));
  }

  async savePlots(): Promise<void> {
    save(`${this.fileName}.png`, await this.#plots.picture());
  }

  /** A page of its own that needs nothing else. */
  async saveReport(): Promise<void> {
    const { reportOf } = await import("./html-report");
    const { sceneChoice, frameSearch } = this.#with;
    const html = await reportOf({
      name: this.about.name,
      facts: [sceneChoice.summary, `${frameSearch.result?.record.timesMs.length ?? frameSearch.detections.all.length} frames were processed.`],
      parts: [this.#part("video-verdict"), this.#part("video-fit-result")],
      plots: this.#fit || frameSearch.detections.all.length ? await this.#plots.picture() : undefined,
      frame: this.#part("video-frame"),
    });
    save(`${this.fileName}.html`, html, "text/html");
  }

  /** The video with ring, trail and numbers drawn into it. */
  async saveFilm(watch: Watch): Promise<void> {
    const { result } = this.#with.frameSearch;
    const source = this.#source;
    if (!result || !(source instanceof VideoSource) || !source.file) throw new Error("Track a video first.");
    const { overlayVideo } = await import("./overlay-video");
    const { blob, extension } = await overlayVideo(source.file, result, this.#with.model.threshold, watch);
    save(`${this.fileName}.${extension}`, blob);
  }

  get fileName(): string {
    return `${this.about.name.replace(/\.[^.]*$/, "").replace(/[^\p{L}\p{N}_-]+/gu, "-").toLowerCase() || "video"}-positions`;
  }
}
