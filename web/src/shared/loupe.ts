/** A magnifier in the picture's corner: what is under the pointer or the chosen point, with a cross-hair. */
import { contextOf, make } from "../dom";
import type { Pixel } from "./canvas";
import { addTicks, stroke } from "./marks";

/** CSS pixels. */
const SIDE = 132;
const LEAST_ZOOM = 6;
/** A small picture is already shown enlarged: the loupe shows at least this much more. */
const MORE_THAN_SHOWN = 3;

export class Loupe {
  readonly place = make("div", { class: "loupe" });
  readonly #canvas = make("canvas");
  readonly #position = make("span");

  constructor() {
    this.place.setAttribute("aria-hidden", "true");
    this.place.hidden = true;
    this.place.append(this.#canvas, this.#position);
  }

  /** Shows `picture` around `at`; `shown` is how much the picture itself is enlarged, `isRight` whether the magnifier goes to the right. */
  show(picture: ImageBitmap, at: Pixel, shown: number, isRight: boolean): void {
    const zoom = Math.max(LEAST_ZOOM, MORE_THAN_SHOWN * shown);
    const density = window.devicePixelRatio || 1;
    this.#canvas.width = this.#canvas.height = Math.round(SIDE * density);
    const context = contextOf(this.#canvas);
    context.scale(density, density);
    context.fillStyle = "#0a0c14";
    context.fillRect(0, 0, SIDE, SIDE);
    context.imageSmoothingEnabled = false;
    // An integer pixel is a pixel's centre.
    const left = SIDE / 2 - (at[0] + 0.5) * zoom;
    const top = SIDE / 2 - (at[1] + 0.5) * zoom;
    context.drawImage(picture, left, top, picture.width * zoom, picture.height * zoom);
    crossHair(context);
    this.#position.textContent = `${at[0].toFixed(1)}, ${at[1].toFixed(1)}`;
    // Never over what is looked at.
    this.place.classList.toggle("loupe-right", isRight);
    this.place.hidden = false;
  }

  hide(): void {
    this.place.hidden = true;
  }
}

function crossHair(context: CanvasRenderingContext2D): void {
  const path = new Path2D();
  addTicks(path, [SIDE / 2, SIDE / 2], 3, SIDE / 2);
  stroke(context, path, "#ffffff", 1);
}
