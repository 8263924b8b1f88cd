/** The colour bar with its two ends. */
import { pixelsOf } from "./colourmap";
import { contextOf } from "../dom";

export interface Scale {
  name: string;
  from: number;
  to: number;
  /** A value with its unit. */
  format: (value: number) => string;
}

export class ScaleBar {
  readonly #box: HTMLElement;

  constructor(box: HTMLElement) {
    this.#box = box;
    const bar = this.#part<HTMLCanvasElement>("canvas");
    const levels = Array.from({ length: bar.width }, (_, x) => x);
    contextOf(bar).putImageData(pixelsOf(levels, bar.width, 1, { from: 0, to: bar.width - 1 }, () => 1), 0, 0);
    this.show(null);
  }

  show(scale: Scale | null): void {
    this.#box.classList.toggle("unseen-kept", scale === null);
    if (!scale) return;
    this.#part(".scale-name").textContent = scale.name;
    this.#end(".scale-min", scale.from, scale.format);
    this.#end(".scale-max", scale.to, scale.format);
  }

  #end(selector: string, value: number, format: (value: number) => string): void {
    const end = this.#part<HTMLDataElement>(selector);
    end.value = String(value);
    end.textContent = format(value);
  }

  #part<T extends HTMLElement>(selector: string): T {
    return this.#box.querySelector<T>(selector)!;
  }
}
