/** Buttons below a picture that enlarge it, and one that lets a finger or the mouse move it. */
import { make } from "../dom";
import type { Zoom } from "./zoom";

interface ZoomBarListener {
  by(factor: number): void;
  all(): void;
}

const STEP = 1.5;

export class ZoomBar {
  readonly place = make("div", { class: "zoom-bar" });
  readonly #out: HTMLButtonElement;
  readonly #in: HTMLButtonElement;
  readonly #all: HTMLButtonElement;
  readonly #move: HTMLButtonElement;
  readonly #scale: HTMLElement;

  constructor(name: string, { by, all }: ZoomBarListener) {
    this.place.setAttribute("role", "group");
    this.place.setAttribute("aria-label", "Zoom");
    this.place.hidden = true;
    this.#out = button("−", `${name}-zoom-out`, () => by(1 / STEP));
    this.#in = button("+", `${name}-zoom-in`, () => by(STEP));
    this.#all = button("Fit", `${name}-zoom-all`, all);
    this.#move = button("Move", `${name}-zoom-move`, () => {
      if (this.#move.getAttribute("aria-disabled") !== "true") this.#move.setAttribute("aria-pressed", String(!this.isMoving));
    });
    this.#out.setAttribute("aria-label", "Zoom out");
    this.#in.setAttribute("aria-label", "Zoom in");
    this.#all.setAttribute("aria-label", "Fit: show the whole picture");
    this.#move.setAttribute("aria-pressed", "false");
    this.#move.title = "While this is on, dragging moves the picture. Two fingers or the middle button always do.";
    this.#scale = make("span", { class: "zoom-scale", part: `${name}-zoom` });
    this.#scale.setAttribute("role", "status");
    this.place.append(this.#out, this.#scale, this.#in, this.#all, this.#move);
  }

  /** Whether dragging moves the picture. */
  get isMoving(): boolean {
    return this.#move.getAttribute("aria-pressed") === "true";
  }

  show({ scale, isWhole, isMost }: Zoom): void {
    this.place.hidden = false;
    const text = `${Math.round(100 * scale)} %`;
    if (this.#scale.textContent !== text) this.#scale.textContent = text;
    // Not disabled: the one that was pressed keeps the focus.
    for (const each of [this.#out, this.#all, this.#move]) each.setAttribute("aria-disabled", String(isWhole));
    this.#in.setAttribute("aria-disabled", String(isMost));
    if (isWhole) this.#move.setAttribute("aria-pressed", "false");
  }
}

function button(text: string, part: string, act: () => void): HTMLButtonElement {
  const made = make("button", { class: "button", text, part });
  made.type = "button";
  made.addEventListener("click", act);
  return made;
}
