/** A picture to click in: pointer and keyboard as picture pixels, marks over it, a loupe in its corner, and a zoom. */
import { contextOf, make } from "../dom";
import { overlayOf, type Pixel, type PixelMap } from "./canvas";
import { Loupe } from "./loupe";
import "./picture-view.css";
import { Pointers, type Spot } from "./pointers";
import { Zoom } from "./zoom";
import { ZoomBar } from "./zoom-bar";

export interface Listener {
  /** Draws the marks. */
  paint(context: CanvasRenderingContext2D, toCanvas: PixelMap): void;
  /** The pointer went down at `at`; `reach` is how many picture pixels a finger's breadth is. */
  press(at: Pixel, reach: number, event: PointerEvent): void;
  /** The pointer moved while down. */
  drag(at: Pixel): void;
  release(): void;
  /** What was pressed was the first of two fingers: as if it had not been. */
  cancel(): void;
  /** A key while the picture has the focus; true if it was of use. */
  key(event: KeyboardEvent): boolean;
}

/** CSS pixels around a mark that count as on it. */
const REACH = 10;
/** Of one press of a key. */
const KEY_ZOOM = 1.5;
/** From here on, a picture's pixels are seen as squares: CSS pixels a pixel. */
const COARSE = 5;
const MIDDLE: Pixel = [0.5, 0.5];

export class PictureView {
  readonly overlay: HTMLCanvasElement;
  readonly #frame: HTMLElement;
  readonly #picture = make("canvas", { class: "picture-zoomed" });
  readonly #loupe = new Loupe();
  readonly #zoom = new Zoom();
  readonly #bar: ZoomBar;
  readonly #listener: Listener;
  #bitmap: ImageBitmap | undefined;
  #aim: Pixel | undefined;
  /** Where the pointer is. */
  #pointed: Pixel | undefined;

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
    this.#bar = new ZoomBar(name, { by: (factor) => this.#zoomBy(factor), all: () => this.showAll() });
    frame.after(this.#bar.place);
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
      this.#zoom.reset();
      this.#picture.width = bitmap.width;
      this.#picture.height = bitmap.height;
      this.#frame.style.setProperty("--aspect", String(bitmap.width / bitmap.height));
    }
    contextOf(this.#picture).drawImage(bitmap, 0, 0);
    this.redraw();
  }

  /** Shows the whole picture. */
  showAll(): void {
    this.#zoom.reset();
    this.redraw();
  }

  /** What the loupe shows while the picture has the focus and no pointer is over it. It is brought into sight. */
  aim(at: Pixel | undefined): void {
    const isNew = at !== undefined && (at[0] !== this.#aim?.[0] || at[1] !== this.#aim[1]);
    this.#aim = at;
    if (isNew && !this.#zoom.isWhole) {
      this.#zoom.reveal(this.#fractionOf(at));
      this.redraw();
    } else this.#magnifyAim();
  }

  redraw(): void {
    if (!this.#bitmap || this.#frame.clientWidth === 0) return;
    this.#place();
    const { context, width, height } = overlayOf(this.overlay, this.size);
    this.#listener.paint(context, (pixel) => {
      const [x, y] = this.#zoom.toFrame(this.#fractionOf(pixel));
      return [x * width, y * height];
    });
    this.#magnifyAim();
  }

  /** Shows the part that the zoom names; the marks are drawn anew, so that they keep their size. */
  #place(): void {
    const [x, y] = this.#zoom.toFrame([0, 0]);
    this.#picture.style.transform = this.#zoom.isWhole ? "" : `translate(${100 * x}%, ${100 * y}%) scale(${this.#zoom.scale})`;
    this.#picture.classList.toggle("coarse", this.#shown >= COARSE);
    this.#bar.show(this.#zoom);
  }

  /** CSS pixels a pixel. */
  get #shown(): number {
    return (this.#frame.clientWidth * this.#zoom.scale) / this.size.width;
  }

  /** An integer pixel is a pixel's centre, which lies half a pixel from the picture's edge. */
  #fractionOf([u, v]: Pixel): Pixel {
    const { width, height } = this.size;
    return [(u + 0.5) / width, (v + 0.5) / height];
  }

  #magnifyAim(): void {
    // Else it would only hide a corner of the picture.
    this.#magnify(this.#pointed ?? (document.activeElement === this.overlay ? this.#aim : undefined));
  }

  #magnify(at: Pixel | undefined): void {
    if (at && this.#bitmap) this.#loupe.show(this.#bitmap, at, this.#shown, this.#zoom.toFrame(this.#fractionOf(at))[0] < 0.5);
    else this.#loupe.hide();
  }

  /** Where in the frame an event is, in fractions of it. */
  #inFrame({ clientX, clientY }: Spot): Pixel {
    const box = this.overlay.getBoundingClientRect();
    return [(clientX - box.left) / box.width, (clientY - box.top) / box.height];
  }

  #at(event: Spot): Pixel {
    const [x, y] = this.#zoom.toPicture(this.#inFrame(event));
    const { width, height } = this.size;
    const within = (value: number, side: number) => Math.min(Math.max(value * side - 0.5, -0.5), side - 0.5);
    return [within(x, width), within(y, height)];
  }

  /** About what is aimed at, where it is seen; else about the middle. */
  #zoomBy(factor: number, about?: Pixel): void {
    const aim = this.#aim && this.#zoom.toFrame(this.#fractionOf(this.#aim));
    const isSeen = aim?.every((x) => x >= 0 && x <= 1);
    this.#zoom.by(factor, about ?? (aim && isSeen ? aim : MIDDLE));
    this.redraw();
  }

  #listen(): void {
    new Pointers(this.overlay, {
      isReady: () => this.#bitmap !== undefined,
      isMoving: () => this.#bar.isMoving,
      point: (event) => {
        this.#pointed = event && this.#at(event);
        this.#magnifyAim();
      },
      press: (event) => this.#listener.press(this.#at(event), REACH / this.#shown, event),
      drag: (event) => this.#listener.drag(this.#at(event)),
      release: () => this.#listener.release(),
      cancel: () => this.#listener.cancel(),
      pan: (by) => {
        this.#zoom.pan([by[0] / this.overlay.clientWidth, by[1] / this.overlay.clientHeight]);
        this.redraw();
      },
      zoom: (factor, about) => this.#zoomBy(factor, this.#inFrame(about)),
      // The page scrolls over a picture that nobody works in.
      takesWheel: (isIn) => document.activeElement === this.overlay && (isIn || !this.#zoom.isWhole),
    });
    for (const change of ["focus", "blur"]) this.overlay.addEventListener(change, () => this.#magnifyAim());
    this.overlay.addEventListener("keydown", (event) => {
      // Keys aim at what they move, wherever the pointer rests.
      this.#pointed = undefined;
      if (this.#listener.key(event) || this.#zoomKey(event)) event.preventDefault();
    });
  }

  #zoomKey({ key, ctrlKey, metaKey, altKey }: KeyboardEvent): boolean {
    if (!this.#bitmap || ctrlKey || metaKey || altKey) return false;
    if (key === "+" || key === "=") this.#zoomBy(KEY_ZOOM);
    else if (key === "-" || key === "−") this.#zoomBy(1 / KEY_ZOOM);
    else if (key === "0") this.showAll();
    else return false;
    return true;
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
