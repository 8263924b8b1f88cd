/** Searches frames for the ball as they come: one at a time; those that come meanwhile are skipped. */
import { GravisightError, type LocaliseOptions } from "gravisight";
import type { Job } from "../shared/job";
import type { Layer } from "../shared/maps";
import type { Overlay } from "../shared/overlay";
import { average, FrameDetections, type FrameDetection } from "./detections";
import type { Model } from "./model";
import type { SceneChoice } from "./scene-choice";
import type { Frame, Source } from "./sources";
import type { TrackResult } from "./track-result";

/** Frames over which the time for a frame is averaged. */
const AVERAGED = 30;
/** So many frames in a row that cannot be read are an error. */
const MOST_UNREADABLE = 30;

export interface FrameSearchListener {
  /** A position is shown, or a frame without one; `isFresh` where it was not known before. */
  shown(detection: FrameDetection | undefined, isFresh: boolean): void;
  /** The number of frames that were searched or skipped has changed. */
  counted(): void;
  /** The source has been stopped, since nothing comes of its frames. */
  failed(thrown: unknown): void;
}

export class FrameSearch {
  readonly detections = new FrameDetections();
  source: Source | undefined;
  layer: Layer = "none";
  skipped = 0;
  /** Whether the source is being tracked. */
  isTracking = false;
  /** Of the whole source, once it was tracked: what was not found then is not there. */
  result: TrackResult | undefined;
  readonly #with: { model: Model; sceneChoice: SceneChoice; overlay: Overlay; job: Job };
  readonly #listener: FrameSearchListener;
  #busy = false;
  /** Frames in a row that could not be read. */
  #unreadable = 0;
  #times: number[] = [];

  constructor(parts: { model: Model; sceneChoice: SceneChoice; overlay: Overlay; job: Job }, listener: FrameSearchListener) {
    this.#with = parts;
    this.#listener = listener;
  }

  /** The average time for a frame; undefined before the first. */
  get milliseconds(): number | undefined {
    return average(this.#times);
  }

  /** Searches frames of another source, or of none. */
  open(source: Source | undefined): void {
    this.source = source;
    this.#busy = false;
  }

  /** Forgets all positions. */
  forget(): void {
    this.detections.clear();
    this.result = undefined;
    this.skipped = 0;
    this.#times = [];
    this.#with.overlay.clear("No position yet");
  }

  /** Whether all that will be found comes from a track. */
  get tracked(): boolean {
    return this.isTracking || this.result !== undefined;
  }

  /** Shows a track in place of all positions. */
  showResult(result: TrackResult): void {
    this.result = result;
    this.detections.replace(result.detections);
    this.search();
  }

  /** Searches the frame that is shown now. */
  search(): void {
    if (this.source?.current) this.take(this.source.current, 0);
  }

  /** The last frame may have come while another was searched. */
  catchUp(): void {
    const current = this.source?.current;
    if (current && !this.#busy && !this.detections.at(current.timeMs)) this.take(current, 0);
  }

  take(frame: Frame, missed: number): void {
    const { source } = this;
    const { model, sceneChoice, overlay } = this.#with;
    if (!source) return;
    if (!this.tracked && (!model.localiser || !sceneChoice.camera || !sceneChoice.scene)) return overlay.showPlain(frame.image, "A frame without a position");
    const known = this.result ? this.result.at(frame.timeMs) : this.detections.at(frame.timeMs);
    const trail = this.result?.trail(frame.timeMs).map(({ image }) => image) ?? [];
    const isNew = frame.timeMs > (this.detections.all.at(-1)?.timeMs ?? -Infinity);
    const counts = source.playing && isNew;
    if (counts) this.skipped += missed;
    if (known && (this.tracked || this.layer === "none") && !this.#busy) {
      overlay.hold(frame.image);
      overlay.show(known.explained === false ? { ...known, depth: null } : known, { layer: "none", sure: known.confidence >= model.threshold, trail });
      this.#listener.shown(known, false);
    } else if (this.tracked) {
      overlay.showPlain(frame.image, "The ball was not found in this frame", trail);
      this.#listener.shown(undefined, false);
    } else if (!this.#busy) {
      void this.#find(frame, isNew);
    } else if (counts) {
      this.skipped++;
    }
    this.#listener.counted();
  }

  async #find(frame: Frame, isNew: boolean): Promise<void> {
    const { source } = this;
    const { model, overlay } = this.#with;
    if (!source) return;
    this.#busy = true;
    const layer = this.layer === "saliency" && source.playing ? "none" : this.layer;
    try {
      overlay.hold(frame.image);
      const found = await this.#localise(frame, layer);
      if (this.source !== source) return;
      this.#unreadable = 0;
      if (!isNew && !this.detections.at(frame.timeMs)) this.skipped = Math.max(0, this.skipped - 1);
      this.#times = [...this.#times, found.milliseconds].slice(-AVERAGED);
      const detection = this.detections.add(frame.timeMs, found, frame.truth);
      overlay.show({ ...found, ...detection }, { layer, sure: detection.confidence >= model.threshold });
      this.#listener.shown(detection, true);
      this.#listener.counted();
    } catch (thrown) {
      if (this.source === source) this.#fail(thrown, frame, source);
      // Or it would be tried for ever.
      return;
    } finally {
      if (this.source === source) this.#busy = false;
    }
    // Somebody has gone on to another frame meanwhile.
    if (!source.playing && source.current && source.current.timeMs !== frame.timeMs) this.search();
  }

  async #localise(frame: Frame, layer: Layer) {
    const { model, sceneChoice, job } = this.#with;
    const { localiser } = model;
    const { camera, cameraSigma, scene } = sceneChoice;
    if (!localiser || !camera || !scene) throw new Error("there is no model, no camera or no ball");
    const ball = { radius: scene.ball.radius };
    const options: LocaliseOptions = { ball, camera, cameraSigma, scene, heatmap: layer === "heatmap", depthMap: layer === "depth", ...(frame.truth && { truth: frame.truth }) };
    if (layer !== "saliency") return localiser.localise(frame.picture, options);
    return job.run("Computing what the depth depends on…", ({ signal }) => localiser.localise(frame.picture, { ...options, saliency: true, signal }));
  }

  #fail(thrown: unknown, frame: Frame, source: Source): void {
    // Browsers may give no pixels of a video just when it starts or changes; the next frame has some.
    const mayCome = source.playing || source.kind === "webcam";
    if (mayCome && thrown instanceof GravisightError && thrown.code === "image-read" && ++this.#unreadable < MOST_UNREADABLE) {
      this.skipped++;
      return;
    }
    source.pause();
    this.#with.overlay.showPlain(frame.image, "A frame without a position");
    this.#listener.failed(thrown);
  }
}
