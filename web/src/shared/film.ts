/** Video files, by the browser's own player. */
import { contextOf, make } from "../dom";
import { blobOf, keptAs } from "./canvas";

/** How long a browser may take to open or to seek, ms. */
const PATIENCE = 20_000;

/** A video's single frames. */
export class Film {
  readonly #video: HTMLVideoElement;
  readonly #message: string;

  private constructor(video: HTMLVideoElement, message: string) {
    this.#video = video;
    this.#message = message;
  }

  static async open(file: File): Promise<Film> {
    const message = `This browser cannot play ${file.name}. Try another format, such as MP4 (H.264) or WebM.`;
    return new Film(await openVideo(file, message), message);
  }

  /** Seconds. */
  get duration(): number {
    return this.#video.duration;
  }

  /**
   * The picture that is shown at `seconds`, at the video's size, as a file of this type; by default as frames are kept.
   */
  async frame(seconds: number, type?: "image/png"): Promise<Blob> {
    this.#video.currentTime = seconds;
    await until(this.#video, "seeked", this.#message);
    const canvas = make("canvas");
    canvas.width = this.#video.videoWidth;
    canvas.height = this.#video.videoHeight;
    contextOf(canvas).drawImage(this.#video, 0, 0);
    return blobOf(canvas, type ?? keptAs(canvas));
  }

  close(): void {
    closeVideo(this.#video);
  }
}

/** A player that nobody sees or hears. */
export function videoElement(): HTMLVideoElement {
  const video = make("video");
  video.muted = true;
  video.playsInline = true;
  video.preload = "auto";
  video.tabIndex = -1;
  video.setAttribute("aria-hidden", "true");
  return video;
}

/** Opens a file in a player; one that cannot be played throws why, or `message` where nobody knows. */
export async function openVideo(file: File, message: string): Promise<HTMLVideoElement> {
  const video = videoElement();
  video.src = URL.createObjectURL(file);
  try {
    await until(video, "loadeddata", message);
    // It may have found the sound alone.
    if (!video.videoWidth) throw new Error(message);
    if (!Number.isFinite(video.duration)) await measure(video, message);
    return video;
  } catch (thrown) {
    closeVideo(video);
    const why = await import("./codec").then(({ whyUnplayable }) => whyUnplayable(file), () => undefined);
    throw why ? new Error(why) : thrown;
  }
}

export function closeVideo(video: HTMLVideoElement): void {
  URL.revokeObjectURL(video.src);
  video.srcObject = null;
  video.removeAttribute("src");
  video.load();
}

/** Waits for an event; an error, or nothing for long, throws `message`. */
export function until(video: HTMLVideoElement, event: "loadeddata" | "seeked", message: string): Promise<void> {
  return new Promise((resolve, reject) => {
    const listening = new AbortController();
    const end = (act: () => void) => () => {
      clearTimeout(timer);
      listening.abort();
      act();
    };
    const timer = setTimeout(end(() => reject(new Error(message))), PATIENCE);
    video.addEventListener(event, end(resolve), { signal: listening.signal });
    video.addEventListener("error", end(() => reject(new Error(message))), { signal: listening.signal });
  });
}

/** A browser's own recording does not know how long it is until its end was looked at. */
async function measure(video: HTMLVideoElement, message: string): Promise<void> {
  for (const seconds of [1e7, 0]) {
    video.currentTime = seconds;
    await until(video, "seeked", message);
  }
  if (!Number.isFinite(video.duration)) throw new Error(message);
}
