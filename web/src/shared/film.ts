/** A video file as single frames, by way of the browser's own player. */
import { contextOf, make } from "../dom";

/** How long a browser may take for one seek, ms. */
const PATIENCE = 15_000;

export class Film {
  readonly #video: HTMLVideoElement;
  readonly #name: string;

  private constructor(video: HTMLVideoElement, name: string) {
    this.#video = video;
    this.#name = name;
  }

  static async open(file: File): Promise<Film> {
    const video = make("video");
    video.muted = true;
    video.playsInline = true;
    video.preload = "auto";
    video.src = URL.createObjectURL(file);
    const film = new Film(video, file.name);
    try {
      await film.#until("loadeddata");
      if (video.duration === Infinity) {
        // A recording whose length is not written down: its end is found by going there.
        video.currentTime = 1e7;
        await film.#until("seeked");
      }
    } catch (thrown) {
      film.close();
      throw thrown;
    }
    return film;
  }

  /** Seconds. */
  get duration(): number {
    return this.#video.duration === Infinity ? this.#video.currentTime : this.#video.duration;
  }

  /** The picture that is shown at `seconds`, at the video's size, as a file. */
  async frame(seconds: number): Promise<Blob> {
    this.#video.currentTime = seconds;
    await this.#until("seeked");
    const canvas = make("canvas");
    canvas.width = this.#video.videoWidth;
    canvas.height = this.#video.videoHeight;
    contextOf(canvas).drawImage(this.#video, 0, 0);
    return fileOf(canvas);
  }

  close(): void {
    URL.revokeObjectURL(this.#video.src);
    this.#video.removeAttribute("src");
    this.#video.load();
  }

  #until(event: "loadeddata" | "seeked"): Promise<void> {
    return new Promise((resolve, reject) => {
      const video = this.#video;
      const timer = setTimeout(() => done(new Error(`The video ${this.#name} gives no picture. Try another format, such as MP4 (H.264) or WebM.`)), PATIENCE);
      const onEvent = () => done();
      const onError = () => done(new Error(`This browser cannot play ${this.#name}. Try MP4 (H.264) or WebM.`));
      function done(problem?: Error): void {
        clearTimeout(timer);
        video.removeEventListener(event, onEvent);
        video.removeEventListener("error", onError);
        if (problem) reject(problem);
        else resolve();
      }
      video.addEventListener(event, onEvent);
      video.addEventListener("error", onError);
    });
  }
}

/** A canvas as a picture file: PNG where it is small, so that nothing is lost; WebP else, for the browser's room. */
export function fileOf(canvas: HTMLCanvasElement): Promise<Blob> {
  const small = canvas.width * canvas.height <= 640 * 480;
  return new Promise((resolve, reject) => {
    const take = (blob: Blob | null) => (blob ? resolve(blob) : reject(new Error("This browser could not make a picture file.")));
    canvas.toBlob(take, small ? "image/png" : "image/webp", 0.95);
  });
}

export function isVideo(file: File): boolean {
  return file.type.startsWith("video/") || /\.(mp4|m4v|mov|webm|mkv|avi|ogv)$/i.test(file.name);
}
