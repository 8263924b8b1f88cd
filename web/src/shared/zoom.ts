/** Which part of a picture its frame shows. Positions are fractions: of the picture, or of the frame. */
import type { Pixel } from "./canvas";

const MOST = 16;
/** What is revealed lies at least this far inside the frame. */
const MARGIN = 0.1;

export class Zoom {
  scale = 1;
  /** The part's upper left corner in the picture. */
  #corner: Pixel = [0, 0];

  get isWhole(): boolean {
    return this.scale === 1;
  }

  get isMost(): boolean {
    return this.scale === MOST;
  }

  toFrame([x, y]: Pixel): Pixel {
    return [(x - this.#corner[0]) * this.scale, (y - this.#corner[1]) * this.scale];
  }

  toPicture([x, y]: Pixel): Pixel {
    return [this.#corner[0] + x / this.scale, this.#corner[1] + y / this.scale];
  }

  /** What lies at `about` in the frame stays there. */
  by(factor: number, about: Pixel): void {
    const fixed = this.toPicture(about);
    const scale = Math.min(Math.max(this.scale * factor, 1), MOST);
    // Whole again, in spite of rounding.
    this.scale = scale < 1.01 ? 1 : scale;
    this.#moveTo([fixed[0] - about[0] / this.scale, fixed[1] - about[1] / this.scale]);
  }

  /** Moves the picture by fractions of the frame. */
  pan([dx, dy]: Pixel): void {
    this.#moveTo([this.#corner[0] - dx / this.scale, this.#corner[1] - dy / this.scale]);
  }

  /** Moves so far that a position in the picture is seen. */
  reveal(at: Pixel): void {
    const beyond = (x: number) => (x < 0 || x > 1 ? x - Math.min(Math.max(x, MARGIN), 1 - MARGIN) : 0);
    const [x, y] = this.toFrame(at);
    this.pan([-beyond(x), -beyond(y)]);
  }

  reset(): void {
    this.scale = 1;
    this.#corner = [0, 0];
  }

  /** Nothing beside the picture is shown. */
  #moveTo([x, y]: Pixel): void {
    const within = (value: number) => Math.min(Math.max(value, 0), 1 - 1 / this.scale);
    this.#corner = [within(x), within(y)];
  }
}
