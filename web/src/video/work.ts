/** The work on a video as a whole: kept in the browser after each track, opened again, saved to a file. */
import { readJson, save } from "../shared/files";
import type { Parts } from "../shared/panel";
import type { Following } from "./following";
import type { FrameSearch } from "./frame-search";
import type { Model } from "./model";
import { when, type SceneChoice } from "./scene-choice";
import { checkedSession, forgetSession, identityOf, isSameVideo, isSession, keepSession, keptSession, sessionOf, type Kept, type Session, type VideoIdentity } from "./session";
import { TrackResult } from "./track-result";

interface With {
  part: Parts;
  sceneChoice: SceneChoice;
  following: Following;
  frameSearch: FrameSearch;
  model: Model;
}

interface WorkListener {
  /** Opens a video that was kept. */
  openVideo(file: File): Promise<void>;
  /** Shows results whose video is not at hand. */
  openWithout(session: Session): void;
  /** The camera and the place are those of a session. */
  sceneChoiceRestored(): void;
}

export class Work {
  readonly #with: With;
  readonly #listener: WorkListener;
  /** Opened, but its video was not. */
  #waiting: Session | undefined;
  #current: Session | undefined;

  constructor(uses: With, listener: WorkListener) {
    this.#with = uses;
    this.#listener = listener;
    uses.part("video-session-forget").addEventListener("click", () => void this.forget());
  }

  /** Goes on with what this browser kept. */
  async resume(): Promise<void> {
    const kept = await keptSession();
    if (kept) await this.#open(kept);
  }

  /** Takes a file that this page saved; false if it is another one. */
  async take(file: File): Promise<boolean> {
    const content = await readJson(file);
    if (!isSession(content)) return false;
    const session = checkedSession(content, file.name);
    const kept = await keptSession();
    const video = kept?.file && isSameVideo(kept.session.video, session.video) ? kept.file : undefined;
    await keepSession(session, video);
    await this.#open({ session, ...(video && { file: video }) });
    return true;
  }

  async #open({ session, file }: Kept): Promise<void> {
    this.#waiting = session;
    if (file) return this.#listener.openVideo(file);
    this.#listener.openWithout(session);
    this.#restore(session);
    this.#say(`Your work on ${session.video.name} is open (saved: ${when(session.saved)}). Open the video again to see the ball in it.`);
  }

  /** A video was opened: if work on it is kept, that is shown. */
  async opened(file: File): Promise<void> {
    const waiting = this.#waiting ?? (await keptSession())?.session;
    this.#waiting = this.#current = undefined;
    this.#say("");
    if (!waiting || !isSameVideo(await identityOf(file), waiting.video)) return;
    this.#restore(waiting);
    this.#say(`Your work on this video is open again (saved: ${when(waiting.saved)}).`);
    await keepSession(waiting, file).catch(() => undefined);
  }

  #restore(session: Session): void {
    const { sceneChoice, following, model } = this.#with;
    const { camera, cameraSigma, cameraNote, scene, court, corrections, record, threshold } = session;
    sceneChoice.restore(session);
    this.#listener.sceneChoiceRestored();
    model.threshold = threshold;
    following.restore({ camera, cameraSigma, cameraAssumed: cameraNote !== "", scene, court }, corrections);
    following.show(new TrackResult(record));
    this.#current = session;
    this.#with.part<HTMLButtonElement>("video-save-session").disabled = false;
  }

  /** Keeps a track that was just made. */
  async found(file: File | undefined, about: { name: string; width: number; height: number; durationMs: number }): Promise<void> {
    const { sceneChoice, following, frameSearch, model } = this.#with;
    const { result } = frameSearch;
    if (!result) return;
    const video: VideoIdentity = file ? await identityOf(file) : { name: about.name, size: 0, sha256: "" };
    const { camera, cameraSigma, cameraFrom, cameraNote, scene, sport } = sceneChoice;
    const session = sessionOf({
      video: { ...about, ...video },
      ...(camera && { camera }),
      cameraSigma,
      cameraFrom,
      cameraNote,
      ...(scene && { scene }),
      sport,
      ...(following.court && { court: following.court }),
      corrections: following.corrections.all,
      threshold: model.threshold,
      record: result.record,
    });
    this.#current = session;
    this.#with.part<HTMLButtonElement>("video-save-session").disabled = false;
    // An example is made again by its button.
    if (!file || sceneChoice.example) return;
    await keepSession(session, file).catch(() => this.#say("This browser has no room to keep your work: save it to a file."));
  }

  save(): void {
    const session = this.#current;
    if (session) save(`${session.video.name.replace(/\.[^.]*$/, "")}.gravisight.json`, JSON.stringify(session));
  }

  /** Another video: what is shown is not work that is kept. */
  close(): void {
    this.#current = undefined;
    this.#with.part<HTMLButtonElement>("video-save-session").disabled = true;
    this.#say("");
  }

  async forget(): Promise<void> {
    this.#waiting = undefined;
    this.#say("");
    await forgetSession().catch(() => undefined);
  }

  #say(text: string): void {
    this.#with.part("video-session").hidden = text === "";
    this.#with.part("video-session-said").textContent = text;
  }
}
