/** The webcam as a video file, which can be tracked. */
import type { Parts } from "../shared/panel";
import type { VideoSource } from "./video-source";

/** A recording ends by itself after so long, ms: tracking takes several times as long. */
const LONGEST = 60_000;

export class WebcamRecorder {
  readonly #button: HTMLButtonElement;
  readonly #recorded: (file: File) => Promise<void>;
  #source: VideoSource | undefined;
  #recorder: MediaRecorder | undefined;
  #timer = 0;

  /** `recorded` opens what was recorded. */
  constructor(part: Parts, recorded: (file: File) => Promise<void>) {
    this.#button = part<HTMLButtonElement>("video-record");
    this.#recorded = recorded;
  }

  /** Serves a webcam, or none. */
  open(source: VideoSource | undefined): void {
    this.#end();
    this.#source = source;
    this.#button.hidden = !source || typeof MediaRecorder !== "function";
    this.#show();
  }

  /** Starts a recording, or ends it and opens it. */
  async toggle(): Promise<void> {
    if (this.#recorder) return this.#recorder.stop();
    const stream = this.#source?.stream;
    if (!stream) return;
    await this.#source?.play();
    const parts: Blob[] = [];
    const recorder = (this.#recorder = new MediaRecorder(stream, { videoBitsPerSecond: 20e6 }));
    recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
    this.#timer = window.setTimeout(() => recorder.stop(), LONGEST);
    const stopped = new Promise<void>((resolve) => recorder.addEventListener("stop", () => resolve(), { once: true }));
    recorder.start();
    this.#show();
    await stopped;
    // Closed meanwhile: nobody wants it.
    if (this.#recorder !== recorder) return;
    this.#end();
    const type = recorder.mimeType.split(";")[0] ?? "";
    const time = new Date().toTimeString().slice(0, 8).replaceAll(":", "-");
    await this.#recorded(new File(parts, `Webcam ${time}.${type.includes("mp4") ? "mp4" : "webm"}`, { type }));
  }

  #end(): void {
    clearTimeout(this.#timer);
    const recorder = this.#recorder;
    this.#recorder = undefined;
    if (recorder?.state === "recording") recorder.stop();
    this.#show();
  }

  #show(): void {
    this.#button.textContent = this.#recorder ? "Stop and open the recording" : "Record";
  }
}
