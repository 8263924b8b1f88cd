/** The ball followed through a whole video: to begin, to correct by a click, to end. */
import { MODELS } from "../shared/core";
import type { Job, Watch } from "../shared/job";
import type { Overlay } from "../shared/overlay";
import type { Parts } from "../shared/panel";
import type { Looker } from "./looker";
import { chosenDevice } from "./model";
import type { Place } from "./place";
import type { Curve } from "./sightings";
import { curveOf, seenOf, Tracking } from "./tracking";
import type { Transport } from "./transport";

interface With {
  part: Parts;
  place: Place;
  overlay: Overlay;
  transport: Transport;
  looker: Looker;
  job: Job;
}

interface Heard {
  /** What was found before is to be forgotten. */
  begin: () => void;
  found: (curve: Curve) => void;
  /** What a person should know of the video. */
  told: (words: string) => void;
}

export class Following {
  readonly #with: With;
  readonly #heard: Heard;
  /** Of the source that is open, once it was tracked. */
  #tracking: Tracking | undefined;

  constructor(uses: With, heard: Heard) {
    this.#with = uses;
    this.#heard = heard;
  }

  /** Frames watched and missed; undefined where nothing was tracked. */
  get counts(): { watched: number; missed: number } | undefined {
    return this.#tracking;
  }

  /** Gives the whole source to a tracker. */
  async start(): Promise<void> {
    const { looker, place, job, overlay, transport } = this.#with;
    const { camera, cameraSigma, scene } = place;
    const { source } = looker;
    if (!source) throw new Error("To track takes a video.");
    source.pause();
    this.#heard.begin();
    looker.tracked = true;
    try {
      await job.run("Loading the model…", async (watch) => {
        // The one that reads sizes, whatever the step Try shows.
        const which = { model: MODELS.any, device: chosenDevice() };
        this.#tracking = await Tracking.through(source, { camera, cameraSigma, scene }, which, watch, ({ image, timeMs }) => {
          overlay.showPlain(image, "A frame that is being looked at");
          transport.showTime(timeMs);
        });
        await this.#show(watch);
        if (this.#tracking.broken) this.#heard.told(this.#tracking.broken);
      });
    } catch (thrown) {
      this.#heard.begin();
      throw thrown;
    }
  }

  async #show(watch: Watch): Promise<void> {
    const { looker, place } = this.#with;
    if (!this.#tracking) return;
    const found = await this.#tracking.track(watch);
    looker.sightings.replace(seenOf(found, place.camera));
    this.#heard.found(curveOf(found));
    looker.source?.seek(looker.sightings.all[0]?.timeMs ?? 0);
  }

  /** A person says where the ball is, after the track was made: it is made anew. */
  async correct(event: MouseEvent): Promise<void> {
    const { looker, job, part } = this.#with;
    const { source } = looker;
    const current = source?.current;
    if (!this.#tracking || !source || !current || job.isRunning) return;
    const { left, top, width, height } = ((event.currentTarget as HTMLElement | null) ?? part("video-overlay")).getBoundingClientRect();
    const at = (share: number, all: number) => share * all - 0.5;
    const { timeMs } = current;
    this.#tracking.mark(timeMs, [at((event.clientX - left) / width, source.width), at((event.clientY - top) / height, source.height)]);
    await job.run("Finding the flights…", (watch) => this.#show(watch));
    source.seek(timeMs);
  }

  end(): void {
    this.#tracking?.dispose();
    this.#tracking = undefined;
    this.#with.looker.tracked = false;
  }

  /** Whether the source can be tracked, and why not. */
  showWhether(): void {
    const { part, place, looker } = this.#with;
    const { camera, scene } = place;
    const { source } = looker;
    const reason = !source
      ? "Closed: choose a video again to track it."
      : source.kind === "webcam"
        ? "The webcam has no end: record a video to track it."
        : source.durationMs <= 0
          ? "One picture is no flight: choose a video to track it."
          : "";
    const missing = !camera ? "its camera" : !scene ? "the place and the ball" : "";
    part<HTMLButtonElement>("video-track").disabled = reason !== "";
    part("video-overlay").dataset.marking = String(this.#tracking !== undefined);
    part("video-track-why").textContent =
      reason ||
      (this.#tracking
        ? "Is the ball elsewhere in a frame? Click it there: the track is made anew."
        : missing
          ? `In pixels, for ${missing} ${missing.includes(" and ") ? "are" : "is"} not known; with ${missing.includes(" and ") ? "them" : "it"}, in metres. A video takes a few times as long as it lasts.`
          : "Every frame, then the flights: a video takes a few times as long as it lasts.");
  }
}
