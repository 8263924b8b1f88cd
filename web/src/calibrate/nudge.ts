/** Buttons that move the chosen point by a pixel or less: for fingers, which have no arrow keys. */
import type { Pixel } from "../shared/canvas";
import type { Parts } from "../shared/panel";

const WAYS: Record<string, Pixel> = { "cal-left": [-1, 0], "cal-up": [0, -1], "cal-down": [0, 1], "cal-right": [1, 0] };
/** A long press repeats: first after this, then at this distance, ms. */
const FIRST = 400;
const EACH = 70;

export class Nudge {
  readonly #part: Parts;

  constructor(part: Parts, move: (way: Pixel, step: number) => void) {
    this.#part = part;
    part<HTMLDetailsElement>("cal-nudge").open = matchMedia("(pointer: coarse)").matches;
    for (const [name, way] of Object.entries(WAYS)) this.#listen(part(name), () => move(way, this.#step));
  }

  /** Whether there is a point to move. */
  enable(isMovable: boolean): void {
    for (const name of Object.keys(WAYS)) this.#part<HTMLButtonElement>(name).disabled = !isMovable;
  }

  get #step(): number {
    return this.#part<HTMLInputElement>("cal-step-fine").checked ? 0.25 : 1;
  }

  #listen(button: HTMLElement, act: () => void): void {
    let timer = 0;
    const end = () => clearTimeout(timer);
    const repeat = () => {
      act();
      timer = window.setTimeout(repeat, EACH);
    };
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      end();
      act();
      timer = window.setTimeout(repeat, FIRST);
    });
    for (const name of ["pointerup", "pointercancel", "pointerleave", "blur"]) button.addEventListener(name, end);
    // Keys and screen readers click without a pointer.
    button.addEventListener("click", (event) => event.detail === 0 && act());
    // A long press opens no menu.
    button.addEventListener("contextmenu", (event) => event.preventDefault());
  }
}
