/** Pointer and keys on the picture: which point is chosen, held and moved. */
import { arrow, inside } from "../shared/picture-view";
import type { Pixel } from "../shared/canvas";
import type { Point, State } from "./state";

export interface ClicksListener {
  /** A click was placed, moved or taken away. */
  changed(): void;
  /** Another point is chosen or held. */
  chosen(): void;
  /** What the magnifier is to show. */
  aim(at: Pixel | undefined): void;
  /** The list is to show the chosen point. */
  reveal(index: number): void;
}

/** With Shift, the cross crosses the picture in this many steps. */
const STRIDES = 32;

export class Clicks {
  /** The point that the next click places. */
  current = 0;
  size: { width: number; height: number } | undefined;
  readonly #state: State;
  readonly #listener: ClicksListener;
  /** The point that the pointer placed last: keys make it exact. */
  #placed: number | undefined;
  /** What the pointer holds, and how far beside it. */
  #dragged: { index: number; beside: Pixel; isMoved: boolean } | undefined;
  /** Where Enter would place the next point. */
  #cross: Pixel | undefined;

  constructor(state: State, listener: ClicksListener) {
    this.#state = state;
    this.#listener = listener;
  }

  get #points(): Point[] {
    return this.#state.given.points;
  }

  /** The point that keys move: what was placed last, else the chosen one where it has a click. */
  get moved(): number | undefined {
    if (this.#placed !== undefined && this.#points[this.#placed]?.click) return this.#placed;
    return this.#points[this.current]?.click ? this.current : undefined;
  }

  /** Where keys would place the next point, if they move none. */
  get cross(): Pixel | undefined {
    return this.moved === undefined ? this.#cross : undefined;
  }

  /** Starts on another picture. */
  open(size: { width: number; height: number }): void {
    this.size = size;
    this.#cross = undefined;
    this.#listener.aim(undefined);
  }

  /** The points are others now. */
  restart(): void {
    this.#placed = undefined;
    this.current = Math.max(0, this.#firstUnclicked());
  }

  choose(index: number): void {
    this.current = index;
    this.#placed = undefined;
    this.#listener.aim(this.#points[index]?.click ?? this.#cross);
    this.#listener.chosen();
  }

  /** False where there is nothing to place or to hold. */
  press(at: Pixel, reach: number): boolean {
    const near = this.#points.flatMap(({ click }, index) => {
      if (!click) return [];
      const [dx, dy] = [click[0] - at[0], click[1] - at[1]];
      const far = dx * dx + dy * dy;
      return far <= reach * reach ? [{ index, far }] : [];
    });
    near.sort((a, b) => a.far - b.far);
    const grabbed = near[0]?.index;
    if (grabbed === undefined && !this.#points[this.current]) return false;
    const held = grabbed === undefined ? undefined : this.#points[grabbed]?.click;
    this.#dragged = { index: grabbed ?? this.current, beside: held ? [held[0] - at[0], held[1] - at[1]] : [0, 0], isMoved: false };
    if (held) {
      // A point that is only touched keeps its place.
      this.#placed = grabbed;
      this.#listener.chosen();
    } else this.drag(at);
    return true;
  }

  drag(at: Pixel): void {
    const held = this.#dragged;
    const point = held && this.#points[held.index];
    if (!point || !this.size) return;
    if (!held.isMoved) this.#state.remember();
    held.isMoved = true;
    delete point.isAbsent;
    point.click = inside([Number((at[0] + held.beside[0]).toFixed(2)), Number((at[1] + held.beside[1]).toFixed(2))], this.size);
    this.#placed = held.index;
    this.#listener.changed();
  }

  release(): void {
    const held = this.#dragged;
    this.#dragged = undefined;
    if (!held) return;
    if (held.index === this.current) this.#goOn(held.index);
    this.#listener.aim(this.#points[held.index]?.click ?? undefined);
    if (held.isMoved) this.#listener.changed();
    else this.#listener.chosen();
  }

  /** True if the key was of use. */
  key(event: KeyboardEvent): boolean {
    if (!this.size || event.ctrlKey || event.metaKey || event.altKey) return false;
    const direction = arrow(event.key);
    if (direction) this.nudge(direction, event.shiftKey ? this.#shifted : 1);
    else if (event.key === "Enter" || event.key === " ") this.#enter();
    else if ((event.key === "Delete" || event.key === "Backspace") && this.moved !== undefined) this.unclick(this.moved);
    else if (event.key.toLowerCase() === "n") this.toggleAbsent();
    else return false;
    return true;
  }

  unclick(index: number): void {
    const point = this.#points[index];
    if (!point?.click) return;
    this.#state.remember();
    point.click = null;
    this.#placed = undefined;
    this.current = index;
    this.#listener.changed();
  }

  /** The chosen point is not in the picture, or is after all. The next one follows. */
  toggleAbsent(): void {
    const point = this.#points[this.current];
    if (!point) return;
    this.#state.remember();
    const isAbsent = point.isAbsent !== true;
    delete point.isAbsent;
    if (isAbsent) {
      point.isAbsent = true;
      point.click = null;
    }
    this.#placed = undefined;
    if (isAbsent) this.#goOn(this.current);
    this.#listener.changed();
  }

  /** Two fingers took the place of one: true if what that one did is to be undone. */
  cancel(): boolean {
    const isMoved = this.#dragged?.isMoved === true;
    this.#dragged = undefined;
    return isMoved;
  }

  /** With Shift, a point is moved by a little, and a cross, which has far to go, by much. */
  get #shifted(): number {
    return this.moved === undefined ? Math.max(1, Math.round((this.size?.width ?? 0) / STRIDES)) : 0.1;
  }

  /** Moves the point that keys move, else the cross. */
  nudge([dx, dy]: Pixel, step: number): void {
    const size = this.size;
    if (!size) return;
    const point = this.moved === undefined ? undefined : this.#points[this.moved];
    const from = point?.click ?? this.#cross ?? middleOf(size);
    const to = inside([from[0] + step * dx, from[1] + step * dy], size);
    if (point) {
      this.#state.remember(`move ${this.moved}`);
      point.click = to;
    } else {
      this.#cross = to;
    }
    this.#listener.aim(to);
    this.#listener.changed();
  }

  #enter(): void {
    const next = this.#points[this.current];
    if (!next || next.click) this.#goOn(this.current);
    else if (this.#cross && this.#placed === undefined) {
      this.#state.remember();
      delete next.isAbsent;
      next.click = this.#cross;
      this.#goOn(this.current);
    } else if (this.size) {
      // From the point that was just made exact to the next one: the cross starts where it was left.
      const left = this.moved === undefined ? undefined : this.#points[this.moved]?.click;
      this.#cross ??= left ?? middleOf(this.size);
      this.#placed = undefined;
      this.#listener.aim(this.#cross);
    }
    this.#listener.changed();
  }

  #firstUnclicked(from = 0): number {
    const open = this.#points.flatMap((point, index) => (point.click || point.isAbsent ? [] : [index]));
    return open.find((index) => index >= from) ?? open[0] ?? -1;
  }

  /** Chooses the next point without a click. */
  #goOn(from: number): void {
    const next = this.#firstUnclicked(from);
    if (next >= 0) this.current = next;
    this.#listener.reveal(this.current);
  }
}

function middleOf({ width, height }: { width: number; height: number }): Pixel {
  return [(width - 1) / 2, (height - 1) / 2];
}
