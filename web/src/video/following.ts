/** The ball followed through a whole video: to begin, to correct by a click, to end. */
import { MODELS } from "../shared/core";
import { findableCourt } from "../shared/find-court";
import type { Job, Watch } from "../shared/job";
import type { Overlay } from "../shared/overlay";
import type { Parts } from "../shared/panel";
import type { Curve } from "./detections";
import type { FrameSearch } from "./frame-search";
import { chosenDevice } from "./model";
import type { SceneChoice } from "./scene-choice";
import { curveOf, detectionsOf, Tracking } from "./tracking";
import type { Transport } from "./transport";

interface With {
  part: Parts;
  sceneChoice: SceneChoice;
  overlay: Overlay;
  transport: Transport;
  frameSearch: FrameSearch;
  job: Job;
}

interface FollowingListener {
  /** What was found before is to be forgotten. */
  begin: () => void;
  found: (curve: Curve) => void;
  /** What a person should know of the video. */
  warn: (message: string) => void;
}

export class Following {
  readonly #with: With;
  readonly #listener: FollowingListener;
  /** Of the source that is open, once it was tracked. */
  #tracking: Tracking | undefined;

  constructor(uses: With, listener: FollowingListener) {
    this.#with = uses;
    this.#listener = listener;
  }

  /** Frames watched and missed; undefined where nothing was tracked. */
  get counts(): { watched: number; missed: number } | undefined {
    return this.#tracking;
  }

  /** Gives the whole source to a tracker. */
  async start(): Promise<void> {
    const { frameSearch, sceneChoice, job, overlay, transport } = this.#with;
    const { camera, cameraSigma, cameraNote, scene, sport } = sceneChoice;
    const { source } = frameSearch;
    if (!source) throw new Error("Tracking needs a video.");
    source.pause();
    this.#listener.begin();
    frameSearch.tracked = true;
    try {
      await job.run("Loading the model…", async (watch) => {
        // The one that reads sizes, whatever the step Try shows.
        const which = { model: MODELS.any, device: chosenDevice() };
        const court = await findableCourt(sport);
        this.#tracking = await Tracking.through(source, { camera, cameraSigma, cameraAssumed: cameraNote !== "", scene, court }, which, watch, ({ image, timeMs }) => {
          overlay.showPlain(image, "The frame being processed");
          transport.showTime(timeMs);
        });
        await this.#show(watch);
        if (this.#tracking.broken) this.#listener.warn(this.#tracking.broken);
      });
    } catch (thrown) {
      this.#listener.begin();
      throw thrown;
    }
  }

  async #show(watch: Watch): Promise<void> {
    const { frameSearch, sceneChoice } = this.#with;
    if (!this.#tracking) return;
    const found = await this.#tracking.track(watch);
    frameSearch.detections.replace(detectionsOf(found, sceneChoice.camera));
    this.#listener.found(curveOf(found));
    frameSearch.source?.seek(frameSearch.detections.all[0]?.timeMs ?? 0);
  }

  /** A person says where the ball is, after the track was made: it is made anew. */
  async correct(event: MouseEvent): Promise<void> {
    const { frameSearch, job, part } = this.#with;
    const { source } = frameSearch;
    const current = source?.current;
    if (!this.#tracking || !source || !current || job.isRunning) return;
    const { left, top, width, height } = ((event.currentTarget as HTMLElement | null) ?? part("video-overlay")).getBoundingClientRect();
    const at = (fraction: number, all: number) => fraction * all - 0.5;
    const { timeMs } = current;
    this.#tracking.mark(timeMs, [at((event.clientX - left) / width, source.width), at((event.clientY - top) / height, source.height)]);
    await job.run("Finding the flights…", (watch) => this.#show(watch));
    source.seek(timeMs);
  }

  end(): void {
    this.#tracking?.dispose();
    this.#tracking = undefined;
    this.#with.frameSearch.tracked = false;
  }

  /** Whether the source can be tracked, and why not. */
  showWhether(): void {
    const { part, sceneChoice, frameSearch } = this.#with;
    const { camera, scene } = sceneChoice;
    const { source } = frameSearch;
    const reason = !source
      ? "No video is open: choose one to track it."
      : source.kind === "webcam"
        ? "A webcam cannot be tracked: record a video first."
        : source.durationMs <= 0
          ? "A single picture cannot be tracked: choose a video."
          : "";
    const missing = !camera ? "its camera" : !scene ? "the place and the ball" : "";
    part<HTMLButtonElement>("video-track").disabled = reason !== "";
    part("video-overlay").dataset.marking = String(this.#tracking !== undefined);
    part("video-track-why").textContent =
      reason ||
      (this.#tracking
        ? "Is the ring not on the ball in some frame? Click the ball there: the track is recomputed."
        : missing
          ? `In pixels, because ${missing} ${missing.includes(" and ") ? "are" : "is"} not known; with ${missing.includes(" and ") ? "them" : "it"}, in metres. Tracking takes several times the length of the video.`
          : "Processes every frame, then fits the flights: this takes several times the length of the video.");
  }
}
