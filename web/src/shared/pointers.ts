/** What a mouse, a pen or fingers do on a picture: one of them presses and drags, two fingers move and enlarge it. */
import type { Pixel } from "./canvas";

/** A place in the window, as events have it. */
export type Spot = Pick<MouseEvent, "clientX" | "clientY">;

export interface PointersListener {
  isReady(): boolean;
  /** Whether dragging moves the picture. */
  isMoving(): boolean;
  /** The pointer is there; undefined where it has left. */
  point(event: PointerEvent | undefined): void;
  press(event: PointerEvent): void;
  drag(event: PointerEvent): void;
  release(): void;
  /** What was pressed was the first of two fingers. */
  cancel(): void;
  /** The picture is moved by CSS pixels. */
  pan(by: Pixel): void;
  zoom(factor: number, about: Spot): void;
  /** Whether the wheel is for the picture and not for the page; `isIn` where it would enlarge. */
  takesWheel(isIn: boolean): boolean;
}

/** A second finger may come this much later, ms. */
const SECOND_FINGER = 120;
/** A finger that moves as far as this is alone, CSS pixels. */
const ALONE = 10;
const MIDDLE_BUTTON = 1;
/** Of a wheel's unit: a notch has about 100. A trackpad's pinch has fewer. */
const WHEEL = 0.002;
const TRACKPAD_PINCH = 0.01;
const WHEEL_LINE = 16;

type Gesture = "none" | "waiting" | "pressed" | "panning" | "pinching" | "over";

export class Pointers {
  readonly #place: HTMLElement;
  readonly #listener: PointersListener;
  /** The last event of each pointer that is down. */
  readonly #down = new Map<number, PointerEvent>();
  #gesture: Gesture = "none";
  /** A finger's press, until it is known to be alone. */
  #first: PointerEvent | undefined;
  #timer = 0;

  constructor(place: HTMLElement, listener: PointersListener) {
    this.#place = place;
    this.#listener = listener;
    place.addEventListener("pointerdown", (event) => this.#press(event));
    place.addEventListener("pointermove", (event) => this.#move(event));
    place.addEventListener("pointerup", (event) => this.#release(event));
    place.addEventListener("pointercancel", (event) => this.#release(event));
    place.addEventListener("pointerleave", () => listener.point(undefined));
    place.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
  }

  #press(event: PointerEvent): void {
    const isMiddle = event.button === MIDDLE_BUTTON;
    if ((event.button !== 0 && !isMiddle) || !this.#listener.isReady()) return;
    this.#place.setPointerCapture(event.pointerId);
    this.#down.set(event.pointerId, event);
    if (this.#down.size === 2) this.#pinch();
    if (this.#down.size !== 1) return;
    if (isMiddle || this.#listener.isMoving()) {
      // No scrolling by the middle button.
      if (isMiddle) event.preventDefault();
      this.#gesture = "panning";
      return;
    }
    this.#listener.point(event);
    this.#first = event;
    this.#gesture = "waiting";
    if (event.pointerType === "touch") this.#timer = window.setTimeout(() => this.#begin(), SECOND_FINGER);
    else this.#begin();
  }

  /** The finger is alone. */
  #begin(): void {
    clearTimeout(this.#timer);
    if (this.#gesture !== "waiting" || !this.#first) return;
    this.#gesture = "pressed";
    this.#listener.press(this.#first);
  }

  #pinch(): void {
    clearTimeout(this.#timer);
    if (this.#gesture === "pressed") this.#listener.cancel();
    this.#listener.point(undefined);
    this.#gesture = "pinching";
  }

  #move(event: PointerEvent): void {
    const last = this.#down.get(event.pointerId);
    if (last && this.#gesture === "pinching") return this.#spread(last, event);
    if (last) this.#down.set(event.pointerId, event);
    if (last && this.#gesture === "panning") return this.#listener.pan([event.clientX - last.clientX, event.clientY - last.clientY]);
    if (this.#gesture === "over") return;
    this.#listener.point(event);
    const first = this.#first;
    if (this.#gesture === "waiting" && first && Math.hypot(event.clientX - first.clientX, event.clientY - first.clientY) > ALONE) this.#begin();
    if (this.#gesture === "pressed") this.#listener.drag(event);
  }

  /** One of two fingers has moved: what lies between them stays between them. */
  #spread(last: PointerEvent, event: PointerEvent): void {
    const other = [...this.#down.values()].find(({ pointerId }) => pointerId !== event.pointerId);
    this.#down.set(event.pointerId, event);
    if (!other) return;
    const far = (from: Spot) => Math.hypot(from.clientX - other.clientX, from.clientY - other.clientY);
    const between = { clientX: (last.clientX + other.clientX) / 2, clientY: (last.clientY + other.clientY) / 2 };
    // In this order: a whole picture cannot be moved.
    if (far(last) > 0) this.#listener.zoom(far(event) / far(last), between);
    this.#listener.pan([(event.clientX - last.clientX) / 2, (event.clientY - last.clientY) / 2]);
  }

  #release(event: PointerEvent): void {
    if (!this.#down.delete(event.pointerId)) return;
    if (this.#gesture === "waiting") this.#begin();
    if (this.#gesture === "pressed") this.#listener.release();
    // The finger that stays after a pinch presses nothing.
    this.#gesture = this.#down.size > 0 ? "over" : "none";
  }

  #wheel(event: WheelEvent): void {
    const { deltaY, deltaMode, ctrlKey } = event;
    if (!this.#listener.isReady() || (!ctrlKey && !this.#listener.takesWheel(deltaY < 0))) return;
    event.preventDefault();
    const pixels = deltaMode === WheelEvent.DOM_DELTA_LINE ? WHEEL_LINE * deltaY : deltaY;
    this.#listener.zoom(Math.exp(-pixels * (ctrlKey ? TRACKPAD_PINCH : WHEEL)), event);
  }
}
