/** A person points at the ball: with a circle around it, with a box to search in, or by choosing one of the likeliest places. */
import type { Candidate, DrawnCircle, Region } from "gravisight";
import { element, make } from "../dom";
import type { Pixel, PixelMap } from "../shared/canvas";
import { drawBox, drawCircle } from "../shared/marks";
import { arrow, inside, PictureView } from "../shared/picture-view";

type Tool = "circle" | "box";

export interface PointingListener {
  /** A circle is drawn, or is no longer. */
  circled(circle: DrawnCircle | undefined): void;
  /** The part of the picture to search, or all of it. */
  boxed(region: Region | undefined): void;
  /** A place was chosen, by its index. */
  chose(index: number): void;
}

const HELP = {
  circle: "Press at the ball’s centre and drag to its edge. Keys: arrows move the circle, + and − resize it, Shift for larger steps, Escape closes.",
  box: "Drag a box around the ball. Keys: arrows move the box, + and − resize it, Enter searches, Escape closes.",
} as const;
const LABELS = { circle: "Picture: draw a circle around the ball", box: "Picture: draw a box to search in" } as const;
/** Of a circle or a box that keys begin, as a share of the picture's shorter side. */
const FIRST_SIZE = { circle: 0.05, box: 0.2 } as const;
/** Sides of the smallest box that the core searches, px. */
const LEAST_BOX = 16;

export class Pointing {
  readonly #view: PictureView;
  readonly #frame = element("pointing-view");
  readonly #row = element("pointing");
  readonly #help = element("pointing-help");
  readonly #places = element("places");
  readonly #buttons = { circle: element<HTMLButtonElement>("circle"), box: element<HTMLButtonElement>("box") };
  readonly #listener: PointingListener;
  #picture: ImageBitmap | undefined;
  /** The picture that was taken last; its bitmap comes later. */
  #asked: Blob | undefined;
  #tool: Tool | undefined;
  /** Where the pointer went down, or the keys put the middle; and how far it reaches, px. */
  #centre: Pixel | undefined;
  #radius = 0;
  #corner: Pixel | undefined;
  #region: Region | undefined;

  constructor(listener: PointingListener) {
    this.#listener = listener;
    this.#view = new PictureView(this.#frame, "pointing-overlay", "pointing-help", {
      paint: (context, toCanvas) => this.#paint(context, toCanvas),
      press: (at) => this.#begin(at),
      drag: (at) => this.#drag(at),
      release: () => this.#release(),
      cancel: () => {
        this.#corner = this.#centre = undefined;
        this.#radius = 0;
        this.#view.redraw();
      },
      key: (event) => this.#key(event),
    });
    this.#buttons.circle.addEventListener("click", () => this.#toggle("circle"));
    this.#buttons.box.addEventListener("click", () => (this.#region ? this.#clearBox() : this.#toggle("box")));
  }

  /** The part of the picture that is to be searched. */
  get region(): Region | undefined {
    return this.#region;
  }

  /** Takes another picture, of which the camera is known; or none. */
  async take(picture: Blob | undefined, searches: boolean): Promise<void> {
    this.#close();
    this.#region = undefined;
    this.#showBox();
    this.showPlaces([], -1);
    this.allowBox(searches);
    this.#asked = picture;
    const bitmap = picture && (await createImageBitmap(picture).catch(() => undefined));
    // Another one came meanwhile.
    if (this.#asked !== picture) return bitmap?.close();
    this.#picture?.close();
    this.#picture = bitmap;
    this.#row.hidden = bitmap === undefined;
  }

  /** Whether the model can search a part of a picture. */
  allowBox(allowed: boolean): void {
    this.#buttons.box.hidden = !allowed;
  }

  /** Offers the likeliest places; `chosen` is the index of one. */
  showPlaces(candidates: readonly Candidate[], chosen: number): void {
    const buttons = candidates.map(({ confidence, depth }, index) => {
      const made = make("button", { class: "button place", part: `place-${index + 1}` }, make("span", { class: "unseen", text: "Position " }));
      made.append(String(index + 1), make("small", { text: `${(100 * confidence).toFixed(0)} %` }));
      made.title = `Confidence ${(100 * confidence).toFixed(0)} %, ${depth.toFixed(1)} m away`;
      made.type = "button";
      made.setAttribute("aria-pressed", String(index === chosen));
      made.addEventListener("click", () => this.#listener.chose(index));
      return made;
    });
    // A single one is no choice.
    const offered = buttons.length > 1 ? [make("span", { class: "quiet", text: "Likeliest positions" }), ...buttons] : [];
    this.#places.replaceChildren(...offered);
  }

  #toggle(tool: Tool): void {
    const again = this.#tool === tool;
    this.#close();
    if (again || !this.#picture) return;
    this.#tool = tool;
    this.#buttons[tool].setAttribute("aria-pressed", "true");
    this.#help.textContent = HELP[tool];
    // A copy: the view closes what it shows.
    void createImageBitmap(this.#picture).then((copy) => {
      if (this.#tool !== tool) return copy.close();
      this.#frame.hidden = false;
      this.#frame.scrollIntoView({ block: "nearest" });
      this.#view.show(copy, LABELS[tool]);
      this.#view.overlay.focus({ preventScroll: true });
    });
  }

  #close(): void {
    const circled = this.#tool === "circle" && this.#centre !== undefined;
    this.#tool = this.#centre = this.#corner = undefined;
    this.#radius = 0;
    this.#frame.hidden = true;
    this.#help.textContent = "";
    for (const button of Object.values(this.#buttons)) button.setAttribute("aria-pressed", "false");
    if (circled) this.#listener.circled(undefined);
  }

  #clearBox(): void {
    this.#region = undefined;
    this.#showBox();
    this.#listener.boxed(undefined);
  }

  #showBox(): void {
    this.#buttons.box.textContent = this.#region ? "Search the whole picture" : "Search in a box";
  }

  #begin(at: Pixel): void {
    this.#corner = at;
    this.#centre = at;
    this.#radius = 0;
    this.#view.redraw();
  }

  #drag([u, v]: Pixel): void {
    if (!this.#corner) return;
    const [x, y] = this.#corner;
    if (this.#tool === "circle") this.#radius = Math.hypot(u - x, v - y);
    else {
      this.#centre = [(u + x) / 2, (v + y) / 2];
      this.#radius = Math.max(Math.abs(u - x), Math.abs(v - y)) / 2;
    }
    this.#changed();
  }

  #release(): void {
    this.#corner = undefined;
    // A press without a drag: the keys and another press can make more of it.
    if (this.#radius < 1) this.#radius = this.#firstSize();
    this.#changed();
    if (this.#tool === "box") this.#search();
  }

  #key(event: KeyboardEvent): boolean {
    const { key, shiftKey } = event;
    if (key === "Escape") {
      const button = this.#tool && this.#buttons[this.#tool];
      this.#close();
      button?.focus();
      return true;
    }
    if (key === "Enter" && this.#tool === "box" && this.#centre) {
      this.#search();
      return true;
    }
    const step = shiftKey && key !== "+" && key !== "*" ? 10 : 1;
    const by = arrow(key);
    const grow = key === "+" || key === "=" || key === "*" ? step : key === "-" || key === "_" ? -(key === "_" ? 10 : step) : 0;
    if (!by && grow === 0) return false;
    if (!this.#centre) {
      const { width, height } = this.#view.size;
      this.#centre = [(width - 1) / 2, (height - 1) / 2];
      this.#radius = this.#firstSize();
    } else if (by) this.#centre = inside([this.#centre[0] + by[0] * step, this.#centre[1] + by[1] * step], this.#view.size);
    else this.#radius = Math.max(1, this.#radius + grow);
    this.#changed();
    // What was moved is what the eye must judge: the middle, or the edge.
    this.#view.aim(by ? this.#centre : [this.#centre[0] + this.#radius, this.#centre[1]]);
    return true;
  }

  #firstSize(): number {
    const { width, height } = this.#view.size;
    return Math.max(4, (FIRST_SIZE[this.#tool ?? "circle"] * Math.min(width, height)) / 2);
  }

  #changed(): void {
    this.#view.redraw();
    if (this.#tool !== "circle" || !this.#centre || this.#radius <= 0) return;
    const { width, height } = this.#view.size;
    // A pointer is placed to about a pixel of the screen; a picture that is shown larger is not sharper.
    const sigmaPx = Math.max(1, width / Math.max(1, this.#frame.clientWidth));
    this.#listener.circled({ centre: this.#centre, radiusPx: this.#radius, sigmaPx, picture: { width, height } });
  }

  /** Ends the drawing of the box and searches in it. */
  #search(): void {
    if (!this.#centre) return;
    const { width, height } = this.#view.size;
    const [u, v] = this.#centre;
    const side = Math.min(Math.max(LEAST_BOX, Math.round(2 * this.#radius)), width, height);
    const start = (middle: number, all: number) => Math.min(Math.max(Math.round(middle + 0.5 - side / 2), 0), all - side);
    this.#region = { left: start(u, width), top: start(v, height), width: side, height: side };
    this.#close();
    this.#showBox();
    this.#buttons.box.focus({ preventScroll: true });
    this.#listener.boxed(this.#region);
  }

  #paint(context: CanvasRenderingContext2D, toCanvas: PixelMap): void {
    if (!this.#centre) return;
    const [u, v] = this.#centre;
    const at = toCanvas(this.#centre);
    const radius = toCanvas([u + this.#radius, v])[0] - at[0];
    if (this.#tool === "circle") drawCircle(context, at, radius);
    else drawBox(context, toCanvas([u - this.#radius, v - this.#radius]), toCanvas([u + this.#radius, v + this.#radius]));
  }
}
