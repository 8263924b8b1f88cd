/** The ball followed through a whole video: to begin, to correct by a click, to end. */
import type { Scene } from "gravisight";
import { findableCourt } from "../shared/find-court";
import type { Job, Watch } from "../shared/job";
import { loadable } from "../shared/models";
import type { ModelSelect } from "../shared/model-select";
import type { Overlay } from "../shared/overlay";
import type { Parts } from "../shared/panel";
import { Corrections } from "./corrections";
import type { FrameSearch } from "./frame-search";
import { chosenDevice } from "./model";
import type { SceneChoice } from "./scene-choice";
import type { TrackResult } from "./track-result";
import { Tracking, type Correction, type Known } from "./tracking";
import type { Transport } from "./transport";

interface With {
  part: Parts;
  sceneChoice: SceneChoice;
  overlay: Overlay;
  transport: Transport;
  frameSearch: FrameSearch;
  job: Job;
  models: ModelSelect;
}

interface FollowingListener {
  /** What was found before is to be forgotten. */
  begin: () => void;
  found: (result: TrackResult) => void;
  /** What a person should know of the video. */
  warn: (message: string) => void;
}

export class Following {
  readonly corrections: Corrections;
  readonly #with: With;
  readonly #listener: FollowingListener;
  /** Of the source that is open, once it was tracked in this page. */
  #tracking: Tracking | undefined;
  /** What the positions were made with. */
  #used: Known | undefined;

  constructor(uses: With, listener: FollowingListener) {
    this.#with = uses;
    this.#listener = listener;
    this.corrections = new Corrections(uses, () => this.revise());
  }

  /** Whose lines the last track used. */
  get court(): string | undefined {
    return this.#used?.court;
  }

  /** The place of the last track, of which its metres are. */
  get scene(): Scene | undefined {
    return this.#used?.scene;
  }

  get result(): TrackResult | undefined {
    return this.#with.frameSearch.result;
  }

  /** Gives the whole source to a tracker; corrections that were made stay. */
  async start(): Promise<void> {
    const { frameSearch, job, overlay, transport, models } = this.#with;
    const { source } = frameSearch;
    if (!source) throw new Error("Tracking needs a video.");
    source.pause();
    const { all } = this.corrections;
    this.#listener.begin();
    this.corrections.restore(all);
    frameSearch.isTracking = true;
    try {
      await job.run("Loading the model…", async (watch) => {
        // One that reads sizes, whatever the step Try shows.
        const which = { model: await loadable(models.choice), device: chosenDevice() };
        const used = await this.#current();
        this.#tracking = await Tracking.through(source, used, which, watch, ({ image, timeMs }) => {
          overlay.showPlain(image, "The frame being processed");
          transport.showTime(timeMs);
        });
        this.#used = used;
        await this.#show(watch);
        if (this.#tracking.broken) this.#listener.warn(this.#tracking.broken);
      });
    } catch (thrown) {
      this.#listener.begin();
      throw thrown;
    }
  }

  /** Makes the track anew: after a correction, or with another camera or place. What was watched is not watched again, if the camera stays. */
  async revise(): Promise<void> {
    const { frameSearch, job } = this.#with;
    const { source } = frameSearch;
    const now = await this.#current();
    const isWatched = this.#tracking && this.#used && same(this.#used.camera, now.camera) && this.#used.court === now.court;
    if (!isWatched || !source) return this.start();
    const timeMs = source.current?.timeMs ?? 0;
    source.pause();
    this.#tracking?.use(now);
    await job.run("Finding the flights…", async (watch) => {
      const before = this.#used;
      this.#used = now;
      // What is shown stays that of the place before.
      await this.#show(watch).catch((thrown: unknown) => {
        this.#used = before;
        throw thrown;
      });
    });
    source.seek(timeMs);
  }

  async #current(): Promise<Known> {
    const { camera, cameraSigma, cameraNote, scene, sport } = this.#with.sceneChoice;
    return { camera, cameraSigma, cameraAssumed: cameraNote !== "", scene, court: await findableCourt(sport) };
  }

  async #show(watch: Watch): Promise<void> {
    const tracking = this.#tracking;
    if (!tracking) return;
    tracking.seeds = this.corrections.all;
    const result = await tracking.track(watch);
    this.show(result);
  }

  /** Shows a track: one that was just made, or one that was kept. */
  show(result: TrackResult): void {
    const { frameSearch } = this.#with;
    frameSearch.isTracking = false;
    frameSearch.showResult(result);
    this.#listener.found(result);
    frameSearch.source?.setFrames?.(result.record.timesMs);
    frameSearch.source?.seek(result.detections[0]?.timeMs ?? 0);
  }

  /** Takes what a kept track was made with. */
  restore(used: Known, corrections: Correction[]): void {
    this.#used = used;
    this.corrections.restore(corrections);
  }

  end(): void {
    this.#tracking?.dispose();
    this.#tracking = this.#used = undefined;
    this.corrections.restore([]);
    this.#with.frameSearch.isTracking = false;
  }

  /** Whether the source can be tracked, and why not. */
  async showWhether(): Promise<void> {
    const { part, sceneChoice, frameSearch } = this.#with;
    const { camera, scene } = sceneChoice;
    const { source, result } = frameSearch;
    const reason = !source
      ? "No video is open: choose one to track it."
      : source.kind === "webcam"
        ? "The page cannot track a webcam live: press Record below, then track the recording."
        : source.durationMs <= 0
          ? "A single picture cannot be tracked: choose a video."
          : "";
    const missing = !camera ? "its camera" : !scene ? "the place and the ball" : "";
    part<HTMLButtonElement>("video-track").disabled = reason !== "";
    part("video-track").classList.toggle("primary", !result);
    part("video-track").textContent = result ? "Track the ball again" : "Track the ball through the video";
    const canMark = result !== undefined && source !== undefined;
    part("video-overlay").dataset.marking = String(canMark);
    part("video-overlay").tabIndex = canMark ? 0 : -1;
    part("video-track-why").textContent =
      reason ||
      (result
        ? "Does the ring miss the ball in a frame? Click the ball there, and the page recomputes the track."
        : missing
          ? `In pixels, because ${missing} ${missing.includes(" and ") ? "are" : "is"} not known; with ${missing.includes(" and ") ? "them" : "it"}, in metres. Tracking takes several times the length of the video.`
          : "Processes every frame, then fits the flights: this takes several times the length of the video.");
    const used = this.#used;
    const now = await this.#current();
    part("video-stale").hidden = !source || !result || !used || (same(used.camera, now.camera) && same(used.scene, now.scene) && same(used.cameraSigma, now.cameraSigma));
  }
}

function same(a: unknown, b: unknown): boolean {
  return JSON.stringify(a) === JSON.stringify(b);
}
