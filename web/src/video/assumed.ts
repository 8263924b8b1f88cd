/** A video without a camera: a phone's is assumed, held level, and the page says so beside the result. */
import type { Job } from "../shared/job";
import { assumedPhone } from "../shared/known-camera";
import type { Parts } from "../shared/panel";
import type { SceneChoice } from "./scene-choice";
import type { Source } from "./sources";
import { VideoSource } from "./video-source";

/** Places without anything at a known position. */
const WITHOUT_COURT = ["", "floor", "free"];

interface With {
  part: Parts;
  job: Job;
  sceneChoice: SceneChoice;
  /** What is open. */
  source: () => Source | undefined;
}

export class Assumed {
  readonly #with: With;

  constructor(uses: With) {
    this.#with = uses;
  }

  /** Assumes a phone for what is open. */
  async use(): Promise<void> {
    const { job, sceneChoice, source } = this.#with;
    const opened = source();
    if (!opened) throw new Error("Open a video or a picture first.");
    const video = opened.kind !== "pictures";
    const known = await job.run("Reading the lens data in the file…", () => assumedPhone(opened, fileOf(opened), video));
    if (opened !== source()) return;
    const { sport, scene } = sceneChoice;
    if (!WITHOUT_COURT.includes(sport) && scene) {
      // Where the court lies is not known: its net and lines would be at wrong places.
      await sceneChoice.choose("free");
      sceneChoice.keepBall(scene.ball);
      known.note += " The court is left out, because its position is not known.";
    }
    sceneChoice.assume(known);
  }

  /** Another source, or a person who knows better. */
  forget(): void {
    this.#with.sceneChoice.assume(undefined);
  }

  /** Says what is assumed. */
  show(): void {
    const { part, sceneChoice } = this.#with;
    const note = sceneChoice.cameraNote;
    part("video-assumed").hidden = note === "";
    part("video-assumed-note").textContent = note;
  }
}

function fileOf(source: Source): Blob | undefined {
  if (source instanceof VideoSource) return source.file;
  const picture = source.current?.picture;
  return picture instanceof Blob ? picture : undefined;
}
