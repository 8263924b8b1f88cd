/** Where frames come from: pictures in memory, or what a `<video>` plays. All are played, stopped and stepped alike. */
import type { Picture, Vector } from "gravisight";

/** A frame that is being shown. */
export interface Frame {
  /** For the localiser. */
  picture: Picture;
  /** For the screen. */
  image: CanvasImageSource;
  timeMs: number;
  /** Where the ball truly is, where that is known. */
  truth?: Vector;
}

export interface Source {
  readonly kind: "video" | "webcam" | "pictures";
  readonly name: string;
  readonly width: number;
  readonly height: number;
  /** Infinite for the webcam. */
  readonly durationMs: number;
  /** What must be in the page for the frames to come. */
  readonly element?: HTMLVideoElement;
  readonly playing: boolean;
  /** The frame that is shown now; undefined where none is yet. */
  readonly current: Frame | undefined;
  /** A frame is shown; `missed` came between the last one and it without being shown. */
  onFrame: (frame: Frame, missed: number) => void;
  /** It plays, or no longer does. */
  onState: () => void;
  play(): Promise<void>;
  pause(): void;
  seek(timeMs: number): void;
  /** When each frame is shown, once that is known: seeking and stepping are exact from then on. */
  setFrames?(timesMs: number[]): void;
  /** A frame forward (1) or back (-1). */
  step(by: 1 | -1): void;
  setRate(rate: number): void;
  dispose(): void;
}

/** Pictures in memory, one after the other; or a single one. */
export class PictureSource implements Source {
  readonly kind = "pictures";
  playing = false;
  onFrame: Source["onFrame"] = () => {};
  onState: Source["onState"] = () => {};
  #index = 0;
  #rate = 1;
  #request = 0;

  constructor(
    readonly name: string,
    readonly width: number,
    readonly height: number,
    readonly frames: Frame[],
  ) {}

  static async file(file: File): Promise<PictureSource> {
    const image = await createImageBitmap(file).catch(() => {
      throw new Error(`${file.name} is not a picture that this browser can read.`);
    });
    return new PictureSource(file.name, image.width, image.height, [{ picture: file, image, timeMs: 0 }]);
  }

  get durationMs(): number {
    return this.frames.at(-1)?.timeMs ?? 0;
  }

  get current(): Frame | undefined {
    return this.frames[this.#index];
  }

  play(): Promise<void> {
    if (this.playing || this.frames.length < 2) return Promise.resolve();
    if (this.#index === this.frames.length - 1) this.#show(0);
    this.playing = true;
    this.onState();
    let last = performance.now();
    let time = this.current?.timeMs ?? 0;
    const tick = (now: number) => {
      time += Math.max(0, now - last) * this.#rate;
      last = now;
      let next = this.#index;
      while (next + 1 < this.frames.length && this.frames[next + 1]!.timeMs <= time) next++;
      if (next !== this.#index) this.#show(next, next - this.#index - 1);
      if (next === this.frames.length - 1) this.pause();
      else if (this.playing) this.#request = requestAnimationFrame(tick);
    };
    this.#request = requestAnimationFrame(tick);
    return Promise.resolve();
  }

  pause(): void {
    cancelAnimationFrame(this.#request);
    if (!this.playing) return;
    this.playing = false;
    this.onState();
  }

  seek(timeMs: number): void {
    const after = this.frames.findIndex((frame) => frame.timeMs > timeMs);
    this.#show(after < 0 ? this.frames.length - 1 : Math.max(0, after - 1));
    // Else the clock of the playing would take it back.
    if (this.playing) {
      this.pause();
      void this.play();
    }
  }

  step(by: 1 | -1): void {
    this.pause();
    this.#show(Math.min(Math.max(this.#index + by, 0), this.frames.length - 1));
  }

  setRate(rate: number): void {
    this.#rate = rate;
  }

  dispose(): void {
    this.pause();
    for (const { image } of this.frames) if (image instanceof ImageBitmap) image.close();
    this.frames.length = 0;
  }

  #show(index: number, missed = 0): void {
    this.#index = index;
    if (this.current) this.onFrame(this.current, missed);
  }
}
