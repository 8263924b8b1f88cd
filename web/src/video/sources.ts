/** Where frames come from: a video file, the webcam, pictures in memory. All are played, stopped and stepped alike. */
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
  /** A frame is shown; `missed` were before it since the last one, and nobody was told. */
  onFrame: (frame: Frame, missed: number) => void;
  /** It plays, or no longer does. */
  onState: () => void;
  play(): Promise<void>;
  pause(): void;
  seek(timeMs: number): void;
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

/** Between two frames where a video has not told yet, in seconds. */
const USUAL_FRAME = 1 / 30;
/** A seek that shows no frame within so many milliseconds has shown it without telling. */
const SEEK_PATIENCE = 150;

/** What a `<video>` plays. */
export class VideoSource implements Source {
  onFrame: Source["onFrame"] = () => {};
  onState: Source["onState"] = () => {};
  current: Frame | undefined;
  readonly element: HTMLVideoElement;
  #frameSeconds = USUAL_FRAME;
  #presented = 0;
  /** The webcam's clock starts with its first frame. */
  #origin: number | undefined;
  #callback = 0;
  #timer = 0;
  #disposed = false;
  readonly #url: string | undefined;
  readonly #stream: MediaStream | undefined;

  private constructor(
    readonly kind: "video" | "webcam",
    readonly name: string,
    element: HTMLVideoElement,
    { url, stream }: { url?: string; stream?: MediaStream },
  ) {
    this.element = element;
    this.#url = url;
    this.#stream = stream;
    for (const event of ["play", "pause", "ended"]) element.addEventListener(event, () => this.onState());
    if (url) element.addEventListener("seeked", () => (this.#timer = window.setTimeout(() => this.#shown(element.currentTime * 1000, 1), SEEK_PATIENCE)));
    // The camera was taken away.
    stream?.getVideoTracks()[0]?.addEventListener("ended", () => this.pause());
    this.#listen();
  }

  static async file(file: File): Promise<VideoSource> {
    const url = URL.createObjectURL(file);
    const element = videoElement();
    try {
      element.src = url;
      await first(element, "loadeddata", `${file.name} is no video or picture that this browser can read. MP4 (H.264) and WebM play nearly everywhere.`);
      if (!element.videoWidth) throw new Error(`${file.name} has sound, but no pictures.`);
      if (!Number.isFinite(element.duration)) await measure(element);
      const source = new VideoSource("video", file.name, element, { url });
      // The browser may have shown the first frame before anybody listened: to seek it shows it again.
      element.currentTime = 0;
      return source;
    } catch (thrown) {
      element.removeAttribute("src");
      URL.revokeObjectURL(url);
      throw thrown;
    }
  }

  static async webcam(): Promise<VideoSource> {
    // Absent where the page is not served over HTTPS.
    if (!navigator.mediaDevices?.getUserMedia) throw new Error("This browser gives this page no webcam: it must be served over HTTPS.");
    const stream = await navigator.mediaDevices.getUserMedia({ video: { facingMode: "environment", frameRate: { ideal: 60 } } }).catch((thrown: unknown) => {
      throw new Error(refusal(thrown));
    });
    try {
      const element = videoElement();
      element.srcObject = stream;
      await first(element, "loadeddata", "The webcam gives no pictures.");
      return new VideoSource("webcam", "Webcam", element, { stream });
    } catch (thrown) {
      for (const track of stream.getTracks()) track.stop();
      throw thrown;
    }
  }

  get width(): number {
    return this.element.videoWidth;
  }

  get height(): number {
    return this.element.videoHeight;
  }

  get durationMs(): number {
    return this.kind === "webcam" ? Infinity : this.element.duration * 1000;
  }

  get playing(): boolean {
    return !this.element.paused && !this.element.ended;
  }

  async play(): Promise<void> {
    for (const track of this.#stream?.getTracks() ?? []) track.enabled = true;
    await this.element.play();
  }

  pause(): void {
    this.element.pause();
    // So that the camera rests while nobody looks.
    for (const track of this.#stream?.getTracks() ?? []) track.enabled = false;
  }

  seek(timeMs: number): void {
    if (this.kind === "video") this.element.currentTime = Math.min(Math.max(timeMs / 1000, 0), this.element.duration);
  }

  step(by: 1 | -1): void {
    this.pause();
    const shown = (this.current?.timeMs ?? 0) / 1000;
    // Into the middle of that frame's time.
    this.seek(1000 * (shown + this.#frameSeconds * (by > 0 ? 1.5 : -0.5)));
  }

  setRate(rate: number): void {
    if (this.kind === "video") this.element.playbackRate = rate;
  }

  dispose(): void {
    this.#disposed = true;
    this.pause();
    clearTimeout(this.#timer);
    this.element.cancelVideoFrameCallback?.(this.#callback);
    for (const track of this.#stream?.getTracks() ?? []) track.stop();
    this.element.srcObject = null;
    this.element.removeAttribute("src");
    this.element.load();
    if (this.#url) URL.revokeObjectURL(this.#url);
  }

  #listen(): void {
    const { element } = this;
    // Typed as always there; Firefox before 132 has none.
    if (typeof element.requestVideoFrameCallback === "function") {
      const onFrame: VideoFrameRequestCallback = (now, { mediaTime, presentedFrames, captureTime }) => {
        if (this.#disposed) return;
        this.#callback = element.requestVideoFrameCallback(onFrame);
        const missed = this.#presented ? presentedFrames - this.#presented - 1 : 0;
        this.#presented = presentedFrames;
        this.#shown(this.#stream ? (captureTime ?? now) : mediaTime * 1000, missed + 1);
      };
      this.#callback = element.requestVideoFrameCallback(onFrame);
      return;
    }
    // Whatever is new at the screen's next picture.
    let last = -1;
    const look = (now: number) => {
      if (this.#disposed) return;
      if (element.currentTime !== last) this.#shown(this.#stream ? now : element.currentTime * 1000, 1);
      last = element.currentTime;
      requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  }

  #shown(clockMs: number, presented: number): void {
    clearTimeout(this.#timer);
    if (this.#disposed) return;
    this.#origin ??= this.#stream ? clockMs : 0;
    const timeMs = clockMs - this.#origin;
    const since = (timeMs - (this.current?.timeMs ?? -Infinity)) / 1000;
    // Of frames one after the other; what was left out makes no frame longer.
    if (this.playing && presented === 1 && since > 1e-3 && since < 0.2) this.#frameSeconds = since;
    this.current = { picture: this.element, image: this.element, timeMs };
    this.onFrame(this.current, this.playing ? Math.max(0, presented - 1) : 0);
  }
}

function videoElement(): HTMLVideoElement {
  const element = document.createElement("video");
  element.muted = true;
  element.playsInline = true;
  element.preload = "auto";
  element.tabIndex = -1;
  element.setAttribute("aria-hidden", "true");
  return element;
}

/** Waits for an event; an error, or nothing for long, throws `words`. */
function first(element: HTMLVideoElement, event: string, words: string, patience = 20_000): Promise<void> {
  return new Promise((resolve, reject) => {
    const listening = new AbortController();
    const end = (act: () => void) => () => {
      clearTimeout(timer);
      listening.abort();
      act();
    };
    const timer = setTimeout(end(() => reject(new Error(words))), patience);
    element.addEventListener(event, end(resolve), { signal: listening.signal });
    element.addEventListener("error", end(() => reject(new Error(words))), { signal: listening.signal });
  });
}

/** A recording of a browser's does not know how long it is until its end was looked at. */
async function measure(element: HTMLVideoElement): Promise<void> {
  const words = "The video does not tell how long it is.";
  element.currentTime = 1e7;
  await first(element, "seeked", words);
  element.currentTime = 0;
  await first(element, "seeked", words);
  if (!Number.isFinite(element.duration)) throw new Error(words);
}

function refusal(thrown: unknown): string {
  const name = thrown instanceof DOMException ? thrown.name : "";
  if (name === "NotAllowedError") return "The webcam was refused. Allow it for this page in the browser’s address bar, and try again.";
  if (name === "NotFoundError" || name === "OverconstrainedError") return "This computer has no webcam that the browser can see.";
  if (name === "NotReadableError") return "The webcam is in use by another program.";
  return `The webcam could not be started: ${thrown instanceof Error ? thrown.message : String(thrown)}`;
}
