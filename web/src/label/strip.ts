/** All frames in a row, coloured and marked by their state. */
import { make, reveal } from "../dom";
import type { FrameState } from "./labelling";

/** A sign as well as a colour, and the label of both. */
export const STATES: Record<FrameState, { sign: string; label: string }> = {
  sure: { sign: "·", label: "proposed, sure" },
  doubtful: { sign: "?", label: "proposed, doubtful" },
  accepted: { sign: "✓", label: "accepted" },
  corrected: { sign: "+", label: "corrected" },
  hidden: { sign: "–", label: "ball not visible" },
  open: { sign: "", label: "not labelled" },
};

export class Strip {
  readonly #place: HTMLElement;
  readonly #choose: (frame: number) => void;
  #cells: HTMLButtonElement[] = [];

  constructor(place: HTMLElement, key: HTMLElement, choose: (frame: number) => void) {
    this.#place = place;
    this.#choose = choose;
    for (const [state, { sign, label }] of Object.entries(STATES)) {
      const swatch = make("span", { class: "lab-cell", text: sign });
      swatch.dataset.state = state;
      swatch.setAttribute("aria-hidden", "true");
      key.append(make("span", {}, swatch, document.createTextNode(label)));
    }
  }

  fill(count: number): void {
    this.#cells = Array.from({ length: count }, (_, frame) => {
      const cell = make("button", { class: "lab-cell", part: `lab-cell-${frame}` });
      cell.type = "button";
      cell.addEventListener("click", () => this.#choose(frame));
      return cell;
    });
    this.#place.replaceChildren(...this.#cells);
  }

  update(current: number, stateOf: (frame: number) => FrameState): void {
    const hadFocus = this.#place.contains(document.activeElement);
    for (const [frame, cell] of this.#cells.entries()) {
      const state = stateOf(frame);
      const isCurrent = frame === current;
      if (cell.dataset.state !== state) {
        cell.dataset.state = state;
        cell.textContent = STATES[state].sign;
        cell.setAttribute("aria-label", `Frame ${frame + 1}: ${STATES[state].label}`);
        cell.title = `Frame ${frame + 1}: ${STATES[state].label}`;
      }
      cell.tabIndex = isCurrent ? 0 : -1;
      if (isCurrent) cell.setAttribute("aria-current", "true");
      else cell.removeAttribute("aria-current");
    }
    const cell = this.#cells[current];
    if (!cell) return;
    if (hadFocus) cell.focus({ preventScroll: true });
    reveal(cell, this.#place);
  }
}
