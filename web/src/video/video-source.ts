/** What a `<video>` plays: a file, or the webcam. */
import { FrameTimes } from "./frame-times";
import { closeVideo, openVideo, until, videoElement } from "../shared/film";
import type { Frame, Source } from "./sources";

/** Between two frames where that is not known yet, in seconds. */
const USUAL_FRAME = 1 / 30;
/** A video that shows no frame within so many milliseconds of being opened, or of a seek, has shown it without telling. */
const PATIENCE = 150;

export class VideoSource implements Source {
  onFrame: Source["onFrame"] = () => {};
  onState: Source["onState"] = () => {};
  current: Frame | undefined;
  readonly element: HTMLVideoElement;
  readonly file: File | undefined;
  #frameSeconds = USUAL_FRAME;
  #frames: FrameTimes | undefined;
  /** Whether a seek is under way whose frame has not come yet. */
  #awaited = true;
  #presented = 0;
  /** The webcam's clock starts with its first frame. */
  #origin: number | undefined;
  #callback = 0;
  #timer = 0;
  #disposed = false;
  readonly #stream: MediaStream | undefined;

  private constructor(
    readonly kind: "video" | "webcam",
    readonly name: string,
    element: HTMLVideoElement,
    from: File | MediaStream,
  ) {
    const stream = from instanceof MediaStream ? from : undefined;
    this.element = element;
    this.#stream = stream;
    this.file = from instanceof File ? from : undefined;
    for (const event of ["play", "pause", "ended"]) element.addEventListener(event, () => this.onState());
    if (!stream) {
      // Its frame most often comes before `seeked`, with its own time; the clock only has the time that was sought.
      const shownSoon = () => {
        clearTimeout(this.#timer);
        if (this.#awaited) this.#timer = window.setTimeout(() => this.#shown(element.currentTime * 1000, 1), PATIENCE);
      };
      element.addEventListener("seeking", () => (this.#awaited = true));
      element.addEventListener("seeked", shownSoon);
      // The first frame may have been shown before anybody listened.
      shownSoon();
    }
    // The camera was taken away.
    stream?.getVideoTracks()[0]?.addEventListener("ended", () => this.pause());
    this.#listen();
  }

  static async file(file: File): Promise<VideoSource> {
    const element = await openVideo(file, `${file.name} is not a video or picture that this browser can read. MP4 (H.264) and WebM play nearly everywhere.`);
    return new VideoSource("video", file.name, element, file);
  }

  static async webcam(): Promise<VideoSource> {
    // Absent where the page is not served over HTTPS.
    if (!navigator.mediaDevices?.getUserMedia) throw new Error("This browser does not let this page use a webcam: the page must be served over HTTPS.");
    const stream = await navigator.mediaDevices.getUserMedia({ video: { facingMode: "environment", frameRate: { ideal: 60 } } }).catch((thrown: unknown) => {
      throw new Error(refusal(thrown));
    });
    try {
      const element = videoElement();
      element.srcObject = stream;
      await until(element, "loadeddata", "The webcam gives no pictures.");
      return new VideoSource("webcam", "Webcam", element, stream);
    } catch (thrown) {
      for (const track of stream.getTracks()) track.stop();
      throw thrown;
    }
  }

  /** The webcam's; undefined of a file. */
  get stream(): MediaStream | undefined {
    return this.#stream;
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

  setFrames(timesMs: number[]): void {
    this.#frames = new FrameTimes(timesMs);
    if (!this.playing && this.current) this.#shown(this.current.timeMs, 1);
  }

  seek(timeMs: number): void {
    if (this.kind !== "video") return;
    const exact = this.#frames?.middleOf(this.#frames.indexAt(timeMs)) ?? timeMs;
    this.element.currentTime = Math.min(Math.max(exact / 1000, 0), this.element.duration);
  }

  step(by: 1 | -1): void {
    this.pause();
    const shown = this.current?.timeMs ?? 0;
    const next = this.#frames?.middleOf(this.#frames.indexAt(shown) + by);
    // Into the middle of that frame's time.
    this.seek(next ?? shown + 1000 * this.#frameSeconds * (by > 0 ? 1.5 : -0.5));
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
    closeVideo(this.element);
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
    this.#awaited = false;
    if (this.#disposed) return;
    this.#origin ??= this.#stream ? clockMs : 0;
    const timeMs = this.#frames?.startOf(clockMs - this.#origin) ?? clockMs - this.#origin;
    const since = (timeMs - (this.current?.timeMs ?? -Infinity)) / 1000;
    // Of frames one after the other; what was left out makes no frame longer.
    if (this.playing && presented === 1 && since > 1e-3 && since < 0.2) this.#frameSeconds = since;
    this.current = { picture: this.element, image: this.element, timeMs };
    this.onFrame(this.current, this.playing ? Math.max(0, presented - 1) : 0);
  }
}

function refusal(thrown: unknown): string {
  const name = thrown instanceof DOMException ? thrown.name : "";
  if (name === "NotAllowedError") return "The webcam was refused. Allow it for this page in the browser’s address bar, and try again.";
  if (name === "NotFoundError" || name === "OverconstrainedError") return "This computer has no webcam that the browser can see.";
  if (name === "NotReadableError") return "The webcam is in use by another program.";
  return `The webcam could not be started: ${thrown instanceof Error ? thrown.message : String(thrown)}`;
}
