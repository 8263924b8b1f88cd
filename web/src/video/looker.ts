/** Finds the ball in frames as they come: in one at a time, and what comes meanwhile is left out. */
import { GravisightError, type LocaliseOptions } from "gravisight";
import type { Job } from "../shared/job";
import type { Layer } from "../shared/maps";
import type { Overlay } from "../shared/overlay";
import type { Model } from "./model";
import type { Place } from "./place";
import { average, Sightings, type Seen } from "./sightings";
import type { Frame, Source } from "./sources";

/** Frames that the time a frame is averaged over. */
const AVERAGED = 30;
/** So many frames in a row that cannot be read are an error. */
const MOST_UNREADABLE = 30;

export interface LookerListener {
  /** A position is shown, or a frame without one; `isFresh` where it was not known before. */
  shown(seen: Seen | undefined, isFresh: boolean): void;
  /** How many frames were looked at or skipped has changed. */
  counted(): void;
  /** The source has been stopped, since nothing comes of its frames. */
  failed(thrown: unknown): void;
}

export class Looker {
  readonly sightings = new Sightings();
  source: Source | undefined;
  layer: Layer = "none";
  skipped = 0;
  /** Whether the whole source was tracked: what was not found then is not there. */
  tracked = false;
  readonly #with: { model: Model; place: Place; overlay: Overlay; job: Job };
  readonly #listener: LookerListener;
  #busy = false;
  /** Frames in a row that could not be read. */
  #unreadable = 0;
  #times: number[] = [];

  constructor(parts: { model: Model; place: Place; overlay: Overlay; job: Job }, listener: LookerListener) {
    this.#with = parts;
    this.#listener = listener;
  }

  /** That a frame takes, on average; undefined before the first. */
  get milliseconds(): number | undefined {
    return average(this.#times);
  }

  /** Looks at frames of another source, or of none. */
  open(source: Source | undefined): void {
    this.source = source;
    this.#busy = false;
  }

  /** Forgets all positions. */
  forget(): void {
    this.sightings.clear();
    this.tracked = false;
    this.skipped = 0;
    this.#times = [];
    this.#with.overlay.clear("No position yet");
  }

  /** Looks at the frame that is shown now. */
  look(): void {
    if (this.source?.current) this.take(this.source.current, 0);
  }

  /** The last frame may have come while another was looked at. */
  catchUp(): void {
    const current = this.source?.current;
    if (current && !this.#busy && !this.sightings.at(current.timeMs)) this.take(current, 0);
  }

  take(frame: Frame, missed: number): void {
    const { source } = this;
    const { model, place, overlay } = this.#with;
    if (!source) return;
    if (!this.tracked && (!model.localiser || !place.camera || !place.scene)) return overlay.showPlain(frame.image, "A frame without a position");
    const known = this.sightings.at(frame.timeMs);
    const isNew = frame.timeMs > (this.sightings.all.at(-1)?.timeMs ?? -Infinity);
    const counts = source.playing && isNew;
    if (counts) this.skipped += missed;
    if (known && (this.tracked || this.layer === "none") && !this.#busy) {
      overlay.hold(frame.image);
      overlay.show(known.explained === false ? { ...known, depth: null } : known, { layer: "none", sure: known.confidence >= model.threshold });
      this.#listener.shown(known, false);
    } else if (this.tracked) {
      overlay.showPlain(frame.image, "The ball is not seen in this frame");
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
      if (!isNew && !this.sightings.at(frame.timeMs)) this.skipped = Math.max(0, this.skipped - 1);
      this.#times = [...this.#times, found.milliseconds].slice(-AVERAGED);
      const seen = this.sightings.add(frame.timeMs, found, frame.truth);
      overlay.show({ ...found, ...seen }, { layer, sure: seen.confidence >= model.threshold });
      this.#listener.shown(seen, true);
      this.#listener.counted();
    } catch (thrown) {
      if (this.source === source) this.#fail(thrown, frame, source);
      // Or it would be tried for ever.
      return;
    } finally {
      if (this.source === source) this.#busy = false;
    }
    // Somebody has gone on to another frame meanwhile.
    if (!source.playing && source.current && source.current.timeMs !== frame.timeMs) this.look();
  }

  async #localise(frame: Frame, layer: Layer) {
    const { model, place, job } = this.#with;
    const { localiser } = model;
    const { camera, scene } = place;
    if (!localiser || !camera || !scene) throw new Error("there is no model, no camera or no ball");
    const ball = { radius: scene.ball.radius };
    const options: LocaliseOptions = { ball, camera, scene, heatmap: layer === "heatmap", depthMap: layer === "depth", ...(frame.truth && { truth: frame.truth }) };
    if (layer !== "saliency") return localiser.localise(frame.picture, options);
    return job.run("Looking for what the depth depends on…", ({ signal }) => localiser.localise(frame.picture, { ...options, saliency: true, signal }));
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
