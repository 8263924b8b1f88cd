/** The frame that was looked at last, with the ball's ring and the network's maps over it. */
import type { FloatMap, Localisation } from "gravisight";
import { pixelsOf, rangeOf } from "../colourmap";
import { contextOf, make } from "../dom";
import { drawFound } from "../marks";
import { ScaleBar, type Scale } from "../scale";

export type Layer = "none" | "heatmap" | "depth" | "saliency";

/** No screen shows more; in pixels. */
const LARGEST_SIDE = 1600;
/** Of a ring that is not to be trusted. */
const DIM = 0.4;
const MAP_OPACITY = 0.7;
/** Cells of the heatmap reach full opacity at this part of its peak. */
const HEATMAP_OPAQUE_AT = 0.4;

export class Overlay {
  readonly #frame: HTMLElement;
  readonly #picture: HTMLCanvasElement;
  readonly #overlay: HTMLCanvasElement;
  readonly #scale: ScaleBar;
  /** The frame that is being looked at: shown together with what is found in it. */
  readonly #next = make("canvas");
  #size = { width: 1, height: 1 };
  #ring: { at: [number, number]; sure: boolean } | undefined;
  #map: { pixels: HTMLCanvasElement; scale: Scale } | undefined;

  constructor(frame: HTMLElement, picture: HTMLCanvasElement, overlay: HTMLCanvasElement, scale: HTMLElement) {
    this.#frame = frame;
    this.#picture = picture;
    this.#overlay = overlay;
    this.#scale = new ScaleBar(scale);
    new ResizeObserver(() => this.#draw()).observe(frame);
  }

  setSize(width: number, height: number): void {
    this.#size = { width, height };
    const shrink = Math.min(1, LARGEST_SIDE / Math.max(width, height, 1));
    for (const canvas of [this.#picture, this.#next]) {
      canvas.width = Math.max(1, Math.round(width * shrink));
      canvas.height = Math.max(1, Math.round(height * shrink));
    }
    this.#frame.style.setProperty("--aspect", String(width / height));
    this.clear("No position yet");
  }

  /** Keeps a frame until {@link show}. */
  hold(image: CanvasImageSource): void {
    contextOf(this.#next).drawImage(image, 0, 0, this.#next.width, this.#next.height);
  }

  /** Shows a frame about which nothing is known. */
  showPlain(image: CanvasImageSource, words: string): void {
    this.hold(image);
    this.#flip();
    this.clear(words);
  }

  /** Shows the frame that is held, and what was found in it. */
  show(found: { image: [number, number]; depth: number; confidence: number } & Partial<Localisation>, threshold: number, layer: Layer): void {
    this.#flip();
    const sure = found.confidence >= threshold;
    this.#ring = { at: found.image, sure };
    this.#map = mapOf(found, layer);
    const [u, v] = found.image.map((x) => x.toFixed(0));
    const where = `the ball at pixel ${u}, ${v}, ${found.depth.toFixed(2)} metres from the camera`;
    this.#overlay.setAttribute("aria-label", sure ? `Found: ${where}` : `Not sure: perhaps ${where}`);
    this.#draw();
  }

  clear(words: string): void {
    this.#ring = this.#map = undefined;
    this.#overlay.setAttribute("aria-label", words);
    this.#draw();
  }

  #flip(): void {
    contextOf(this.#picture).drawImage(this.#next, 0, 0);
  }

  #draw(): void {
    const { width, height } = this.#frame.getBoundingClientRect();
    const density = window.devicePixelRatio || 1;
    this.#overlay.width = Math.max(1, Math.round(width * density));
    this.#overlay.height = Math.max(1, Math.round(height * density));
    const context = contextOf(this.#overlay);
    context.scale(density, density);
    this.#scale.show(this.#map?.scale ?? null);
    if (this.#map) {
      context.globalAlpha = MAP_OPACITY;
      context.imageSmoothingQuality = "high";
      context.drawImage(this.#map.pixels, 0, 0, width, height);
    }
    if (!this.#ring) return;
    const { at: [u, v], sure } = this.#ring;
    context.globalAlpha = sure ? 1 : DIM;
    // An integer pixel is a pixel's centre, which lies half a pixel from the picture's edge.
    drawFound(context, ((u + 0.5) / this.#size.width) * width, ((v + 0.5) / this.#size.height) * height);
  }
}

function mapOf({ heatmap, depthMap, saliency }: Partial<Localisation>, layer: Layer): { pixels: HTMLCanvasElement; scale: Scale } | undefined {
  if (layer === "heatmap" && heatmap) {
    const range = { from: 0, to: rangeOf(heatmap.values).to };
    const words = (value: number) => (value === 0 ? "0" : `${(100 * value).toPrecision(2)} %`);
    return { pixels: painted(heatmap, range, (level) => Math.min(1, level / HEATMAP_OPAQUE_AT)), scale: { name: "Probability", ...range, words } };
  }
  if (layer === "depth" && depthMap) {
    const range = rangeOf(depthMap.values);
    return { pixels: painted(depthMap, range, () => 1), scale: { name: "Depth", ...range, words: (value) => `${value.toFixed(2)} m` } };
  }
  if (layer === "saliency" && saliency) {
    // How much, whichever way.
    const strength = { ...saliency, values: saliency.values.map(Math.abs) };
    const range = { from: 0, to: rangeOf(strength.values).to };
    const words = (value: number) => (value === 0 ? "0" : `${value.toPrecision(2)} m`);
    return { pixels: painted(strength, range, (level) => Math.min(1, 0.15 + 2 * level)), scale: { name: "Depth changes by", ...range, words } };
  }
  return undefined;
}

function painted({ values, width, height }: FloatMap, range: { from: number; to: number }, opacity: (level: number) => number): HTMLCanvasElement {
  const canvas = make("canvas");
  canvas.width = width;
  canvas.height = height;
  contextOf(canvas).putImageData(pixelsOf(values, width, height, range, opacity), 0, 0);
  return canvas;
}
