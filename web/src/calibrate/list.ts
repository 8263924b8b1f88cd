/** The list of points: one is chosen, own ones can be written, each says how well its click fits. */
import { make, reveal, textButton } from "../dom";
import type { Point } from "./state";

export interface ListListener {
  choose(index: number): void;
  /** The click is to be taken away. */
  unclick(index: number): void;
  rename(index: number, name: string): void;
  place(index: number, axis: 0 | 1 | 2, metres: number | null): void;
  remove(index: number): void;
}

/** How a point is. */
export interface Standing {
  residual?: [number, number] | undefined;
  outlier: boolean;
}

interface Row {
  item: HTMLLIElement;
  choose: HTMLButtonElement;
  state: HTMLElement;
  unclick: HTMLButtonElement;
}

export class PointList {
  readonly #list: HTMLElement;
  readonly #listener: ListListener;
  #rows: Row[] = [];

  constructor(list: HTMLElement, listener: ListListener) {
    this.#list = list;
    this.#listener = listener;
  }

  /** Makes the rows anew; `own` ones can be written. */
  fill(points: Point[], own: boolean): void {
    this.#rows = points.map((point, index) => (own ? this.#ownRow(point, index) : this.#courtRow(point, index)));
    this.#list.replaceChildren(...this.#rows.map((row) => row.item));
  }

  /** Shows how each point is. */
  update(points: Point[], current: number, standing: (index: number) => Standing): void {
    for (const [index, row] of this.#rows.entries()) {
      const point = points[index];
      if (!point) continue;
      const { residual, outlier } = standing(index);
      if (index === current) row.item.setAttribute("aria-current", "true");
      else row.item.removeAttribute("aria-current");
      row.item.classList.toggle("outlier", outlier);
      row.item.classList.toggle("absent", point.isAbsent === true);
      row.choose.setAttribute("aria-pressed", String(index === current));
      row.unclick.hidden = point.click === null;
      row.state.textContent = stateText(point, residual, outlier);
    }
  }

  reveal(index: number): void {
    const row = this.#rows[index];
    if (row) reveal(row.item, this.#list);
  }

  #courtRow(point: Point, index: number): Row {
    const where = make("small", { text: `(${point.world.join(", ")}) m` });
    const choose = this.#chooser(index, make("span", { class: "cal-number", text: String(index + 1) }), make("span", { text: point.name }), where);
    return this.#row(index, "", choose);
  }

  #ownRow(point: Point, index: number): Row {
    const choose = this.#chooser(index, make("span", { class: "cal-number", text: String(index + 1) }));
    choose.setAttribute("aria-label", `Choose point ${index + 1}`);
    const name = make("input", { part: `cal-name-${index}` });
    name.type = "text";
    name.value = point.name;
    name.placeholder = "name";
    name.setAttribute("aria-label", `Name of point ${index + 1}`);
    name.addEventListener("input", () => this.#listener.rename(index, name.value));
    const remove = textButton("×", `cal-remove-${index}`, `Remove point ${index + 1}`, () => this.#listener.remove(index));
    remove.classList.add("cal-remove");
    remove.title = "Remove";
    const axes = ([0, 1, 2] as const).map((axis) => {
      const letter = "xyz"[axis] ?? "";
      const input = make("input", { part: `cal-${letter}-${index}` });
      input.type = "number";
      input.step = "any";
      input.inputMode = "decimal";
      input.value = String(point.world[axis] ?? "");
      input.setAttribute("aria-label", `${letter} of point ${index + 1}, metres`);
      input.addEventListener("input", () => this.#listener.place(index, axis, Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null));
      return make("label", { class: "cal-axis" }, make("span", { text: letter }), input);
    });
    for (const input of [name, ...axes.flatMap((label) => [...label.querySelectorAll("input")])]) {
      input.addEventListener("focus", () => this.#listener.choose(index));
    }
    return this.#row(index, "own", choose, name, remove, make("div", { class: "cal-axes" }, ...axes));
  }

  #chooser(index: number, ...content: Node[]): HTMLButtonElement {
    const choose = make("button", { class: "cal-choose", part: `cal-point-${index}` }, ...content);
    choose.type = "button";
    choose.addEventListener("click", () => this.#listener.choose(index));
    return choose;
  }

  #row(index: number, kind: string, choose: HTMLButtonElement, ...more: Node[]): Row {
    const state = make("span", { class: "cal-state", part: `cal-state-${index}` });
    const unclick = textButton("Delete click", `cal-unclick-${index}`, `Delete click on point ${index + 1}`, () => this.#listener.unclick(index));
    const item = make("li", { class: kind }, choose, ...more, make("div", { class: "cal-standing" }, state, unclick));
    return { item, choose, state, unclick };
  }
}

function stateText({ click, isAbsent }: Point, residual: [number, number] | undefined, outlier: boolean): string {
  if (!click) return isAbsent ? "not in the picture" : "not clicked";
  if (!residual) return `clicked at ${click.map((value) => value.toFixed(1)).join(", ")}`;
  return outlier ? `wrong click? left out: ${offBy(residual)}` : `off by ${offBy(residual)}`;
}

/** A residual as text: the camera's place less the click's. */
export function offBy([x, y]: [number, number]): string {
  return `${Math.abs(x).toFixed(1)} px ${x < 0 ? "left" : "right"}, ${Math.abs(y).toFixed(1)} px ${y < 0 ? "up" : "down"}`;
}
