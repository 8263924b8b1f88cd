/** The camera of a video by its court, without clicks: in its first frame, which every later one is compared with. */
import type { CourtSearch } from "gravisight";
import { pictureFile } from "../shared/canvas";
import { findableCourt, findCourt, foundInWords } from "../shared/find-court";
import { Film } from "../shared/film";
import type { Job } from "../shared/job";
import type { Parts } from "../shared/panel";
import { workspace } from "../shared/workspace";
import type { SceneChoice } from "./scene-choice";
import type { Source } from "./sources";
import { VideoSource } from "./video-source";

interface With {
  part: Parts;
  job: Job;
  sceneChoice: SceneChoice;
  /** What is open. */
  source: () => Source | undefined;
}

/** A search, and the picture that it was in. */
interface Found {
  search: CourtSearch;
  picture: Blob;
  name: string;
  /** The video's or picture's own. */
  of: string;
  sport: string;
}

export class Court {
  readonly #with: With;
  /** Whose camera is in use. */
  #used: Found | undefined;

  constructor(uses: With) {
    this.#with = uses;
  }

  /** Offers the search, beside the other ways to a camera, where the place has a court whose lines are known. */
  async showWhether(): Promise<void> {
    const { part, sceneChoice, source } = this.#with;
    const { sport } = sceneChoice;
    if (this.#used && JSON.stringify(sceneChoice.camera) !== JSON.stringify(this.#used.search.calibration?.camera)) this.forget();
    const isFindable = (await findableCourt(sport)) !== undefined;
    // Unless another one was chosen meanwhile.
    if (sport !== sceneChoice.sport) return;
    part("video-find").hidden = !isFindable;
    part("video-find").textContent = `Find the court in this ${source()?.kind === "pictures" ? "picture" : "video"}`;
    part("video-calibrate").classList.toggle("primary", !isFindable);
    const hint = sport ? "" : "Choose the place above: the page can find many courts by their painted lines.";
    part("video-find-note").textContent = isFindable ? "The page can look for this court’s painted lines." : hint;
  }

  /** Finds the court. A sure one's camera is used; about everything else the step Calibrate asks. */
  async find(): Promise<void> {
    const { job, sceneChoice, source } = this.#with;
    const opened = source();
    const { sport } = sceneChoice;
    const court = await findableCourt(sport);
    if (!opened || !court) return;
    opened.pause();
    const { picture, search } = await job.run("Looking for the court’s lines…", async ({ signal }) => {
      const picture = await firstFrame(opened);
      return { picture, search: await findCourt(picture, court, signal) };
    });
    const found = { search, picture, name: `the first frame of ${opened.name}`, of: opened.name, sport };
    const { found: { verdict }, calibration } = search;
    if (verdict !== "sure" || !calibration) return this.#ask(found);
    this.#used = found;
    workspace.setCamera(calibration.camera, calibration.oneSigma, { from: `found from the court in ${found.name}`, of: [opened.name], court });
    this.#show();
  }

  /** Shows the lines in the step Calibrate. */
  check(): void {
    if (this.#used) this.#ask(this.#used);
  }

  /** Another video or another camera: what was found is no longer in use. */
  forget(): void {
    this.#used = undefined;
    this.#show();
  }

  #ask({ picture, name, of, sport, search }: Found): void {
    workspace.calibrate({ picture, name, of, sport, search, back: "video" });
  }

  #show(): void {
    const { part } = this.#with;
    part("video-found").hidden = this.#used === undefined;
    part("video-found-said").textContent = this.#used ? `Found: ${foundInWords(this.#used.search.found)}. The positions are in metres.` : "";
  }
}

/** Exactly: lines are measured in it. */
async function firstFrame(source: Source): Promise<Blob> {
  if (source instanceof VideoSource && source.file) {
    const film = await Film.open(source.file);
    try {
      return await film.frame(0, "image/png");
    } finally {
      film.close();
    }
  }
  const { current, width, height } = source;
  if (!current) throw new Error("There is no frame yet.");
  return pictureFile(current.image, { width, height });
}
