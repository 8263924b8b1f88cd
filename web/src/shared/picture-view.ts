/** A picture to click in: pointer and keyboard as picture pixels, marks over it, a loupe in its corner. */
import { contextOf, make } from "../dom";
import { overlayOf, type Pixel, type PixelMap } from "./canvas";
import { Loupe } from "./loupe";
import "./picture-view.css";

export interface Listener {
  /** Draws the marks. */
  paint(context: CanvasRenderingContext2D, toCanvas: PixelMap): void;
  /** The pointer went down at `at`; `reach` is how many picture pixels a finger's breadth is. */
  press(at: Pixel, reach: number, event: PointerEvent): void;
  /** The pointer moved while down. */
  drag(at: Pixel): void;
  release(): void;
  /** A key while the picture has the focus; true if it was of use. */
  key(event: KeyboardEvent): boolean;
}

/** CSS pixels around a mark that count as on it. */
const REACH = 10;

export class PictureView {
  readonly overlay: HTMLCanvasElement;
  readonly #frame: HTMLElement;
  readonly #picture = make("canvas");
  readonly #loupe = new Loupe();
  readonly #listener: Listener;
  #bitmap: ImageBitmap | undefined;
  #aim: Pixel | undefined;
  /** Where the pointer is. */
  #pointed: Pixel | undefined;
  #down = false;

  constructor(frame: HTMLElement, name: string, describedBy: string, listener: Listener) {
    this.#frame = frame;
    this.#listener = listener;
    this.overlay = make("canvas", { class: "picture-overlay", part: name });
    this.overlay.tabIndex = 0;
    // Arrow keys are the page's own here, not a screen reader's.
    this.overlay.setAttribute("role", "application");
    this.overlay.setAttribute("aria-roledescription", "picture");
    this.overlay.setAttribute("aria-describedby", describedBy);
    this.#picture.setAttribute("aria-hidden", "true");
    frame.classList.add("frame");
    frame.append(this.#picture, this.overlay, this.#loupe.place);
    new ResizeObserver(() => this.redraw()).observe(frame);
    this.#listen();
  }

  get size(): { width: number; height: number } {
    return { width: this.#bitmap?.width ?? 1, height: this.#bitmap?.height ?? 1 };
  }

  /** Shows a picture in place of the last one, which is closed. */
  show(bitmap: ImageBitmap, label: string): void {
    const resized = bitmap.width !== this.#bitmap?.width || bitmap.height !== this.#bitmap.height;
    if (bitmap !== this.#bitmap) this.#bitmap?.close();
    this.#bitmap = bitmap;
    this.overlay.setAttribute("aria-label", label);
    if (resized) {
      this.#picture.width = bitmap.width;
      this.#picture.height = bitmap.height;
      this.#frame.style.setProperty("--aspect", String(bitmap.width / bitmap.height));
    }
    contextOf(this.#picture).drawImage(bitmap, 0, 0);
    this.redraw();
  }

  /** What the loupe shows while the picture has the focus and no pointer is over it. */
  aim(at: Pixel | undefined): void {
    this.#aim = at;
    this.#magnifyAim();
  }

  redraw(): void {
    if (!this.#bitmap || this.#frame.clientWidth === 0) return;
    const { context, toCanvas } = overlayOf(this.overlay, this.size);
    this.#listener.paint(context, toCanvas);
    this.#magnifyAim();
  }

  #magnifyAim(): void {
    // Else it would only hide a corner of the picture.
    this.#magnify(this.#pointed ?? (document.activeElement === this.overlay ? this.#aim : undefined));
  }

  #magnify(at: Pixel | undefined): void {
    if (at && this.#bitmap) this.#loupe.show(this.#bitmap, at, this.#frame.clientWidth / this.#bitmap.width);
    else this.#loupe.hide();
  }

  #at(event: PointerEvent): Pixel {
    const box = this.overlay.getBoundingClientRect();
    const { width, height } = this.size;
    const within = (value: number, side: number) => Math.min(Math.max(value * side - 0.5, -0.5), side - 0.5);
    return [within((event.clientX - box.left) / box.width, width), within((event.clientY - box.top) / box.height, height)];
  }

  #listen(): void {
    this.overlay.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !this.#bitmap) return;
      this.overlay.setPointerCapture(event.pointerId);
      this.#down = true;
      const at = this.#at(event);
      this.#pointed = at;
      this.#listener.press(at, (REACH * this.size.width) / this.#frame.clientWidth, event);
    });
    this.overlay.addEventListener("pointermove", (event) => {
      const at = this.#at(event);
      this.#pointed = at;
      if (this.#down) this.#listener.drag(at);
      this.#magnifyAim();
    });
    const up = () => {
      if (this.#down) this.#listener.release();
      this.#down = false;
    };
    this.overlay.addEventListener("pointerup", up);
    this.overlay.addEventListener("pointercancel", up);
    this.overlay.addEventListener("pointerleave", () => {
      this.#pointed = undefined;
      this.#magnifyAim();
    });
    for (const change of ["focus", "blur"]) this.overlay.addEventListener(change, () => this.#magnifyAim());
    this.overlay.addEventListener("keydown", (event) => {
      // Keys aim at what they move, wherever the pointer rests.
      this.#pointed = undefined;
      if (this.#listener.key(event)) event.preventDefault();
    });
  }
}

/** Clamps a pixel to a picture. */
export function inside([u, v]: Pixel, { width, height }: { width: number; height: number }): Pixel {
  const tidy = (value: number, side: number) => Math.min(Math.max(Number(value.toFixed(4)), -0.5), side - 0.5);
  return [tidy(u, width), tidy(v, height)];
}

/** Which way an arrow key points; undefined for other keys. */
export function arrow(key: string): Pixel | undefined {
  return ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] } as Record<string, Pixel>)[key];
}
