/** All frames in a row, coloured and marked by their state. */
import { make, reveal } from "../dom";
import type { FrameState } from "./labelling";

/** A sign as well as a colour, and the words of both. */
export const STATES: Record<FrameState, { sign: string; words: string }> = {
  sure: { sign: "·", words: "proposed, sure" },
  doubtful: { sign: "?", words: "proposed, doubtful" },
  accepted: { sign: "✓", words: "accepted" },
  corrected: { sign: "+", words: "corrected" },
  hidden: { sign: "–", words: "ball not visible" },
  open: { sign: "", words: "not labelled" },
};

export class Strip {
  readonly #place: HTMLElement;
  readonly #choose: (frame: number) => void;
  #cells: HTMLButtonElement[] = [];

  constructor(place: HTMLElement, key: HTMLElement, choose: (frame: number) => void) {
    this.#place = place;
    this.#choose = choose;
    for (const [state, { sign, words }] of Object.entries(STATES)) {
      const swatch = make("span", { class: "lab-cell", text: sign });
      swatch.dataset.state = state;
      swatch.setAttribute("aria-hidden", "true");
      key.append(make("span", {}, swatch, document.createTextNode(words)));
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
        cell.setAttribute("aria-label", `Frame ${frame + 1}: ${STATES[state].words}`);
        cell.title = `Frame ${frame + 1}: ${STATES[state].words}`;
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
