/** The picture, large, with the network's maps and the two positions drawn over it. */
import type { FloatMap, Localisation } from "gravisight";
import { pixelsOf, rangeOf } from "./colourmap";
import { contextOf, element, make } from "./dom";
import { drawFound, drawTruth } from "./marks";
import { ScaleBar, type Scale } from "./scale";

export type Layer = "none" | "heatmap" | "depth";

/** No picture is kept larger than this: no screen shows more. In pixels. */
const LARGEST_SIDE = 1600;
/** Cells of the heatmap reach full opacity at this part of its peak, so that its flanks are seen and its feet are not. */
const HEATMAP_OPAQUE_AT = 0.4;

interface Painted {
  pixels: HTMLCanvasElement;
  scale: Scale;
}

export class Stage {
  readonly #frame = element("frame");
  readonly #picture = element<HTMLCanvasElement>("picture");
  readonly #overlay = element<HTMLCanvasElement>("overlay");
  readonly #scale = new ScaleBar(element("scale"));
  readonly #key = element("key");
  /** Of the picture as it was given, in pixels. */
  #size = { width: 1, height: 1 };
  #painted: Partial<Record<Layer, Painted>> = {};
  #found: [number, number] | undefined;
  #truth: [number, number] | undefined;
  #layer: Layer = "none";
  #opacity = 1;

  constructor() {
    new ResizeObserver(() => this.#draw()).observe(this.#frame);
  }

  /** Shows a picture without a result; false where the browser cannot read it. */
  async showPicture(picture: Blob, isCurrent: () => boolean): Promise<boolean> {
    const bitmap = await createImageBitmap(picture).catch(() => null);
    if (!isCurrent()) return bitmap !== null;
    this.clear();
    const { width, height } = bitmap ?? { width: 1, height: 1 };
    this.#size = { width, height };
    const shrink = Math.min(1, LARGEST_SIDE / Math.max(width, height));
    this.#picture.width = Math.max(1, Math.round(width * shrink));
    this.#picture.height = Math.max(1, Math.round(height * shrink));
    this.#frame.style.setProperty("--aspect", String(width / height));
    if (bitmap) contextOf(this.#picture).drawImage(bitmap, 0, 0, this.#picture.width, this.#picture.height);
    bitmap?.close();
    this.#draw();
    return bitmap !== null;
  }

  /** Shows what was found, over the picture. */
  showResult(result: Localisation, truth: [number, number] | undefined): void {
    this.#found = result.image;
    this.#truth = truth;
    this.#painted = painted(result);
    const [u, v] = result.image.map((x) => x.toFixed(1));
    this.#overlay.setAttribute("aria-label", `The ball was found at pixel ${u}, ${v}, ${result.depth.toFixed(2)} metres from the camera`);
    const entries = [make("span", { class: "key-found", text: "Found" })];
    if (truth) entries.push(make("span", { class: "key-truth", text: "True position" }));
    this.#key.replaceChildren(...entries);
    this.#draw();
  }

  /** Removes the result; the picture stays. */
  clear(): void {
    this.#found = this.#truth = undefined;
    this.#painted = {};
    this.#key.replaceChildren();
    this.#overlay.setAttribute("aria-label", "Nothing found yet");
    this.#draw();
  }

  setLayer(layer: Layer): void {
    this.#layer = layer;
    this.#draw();
  }

  setOpacity(opacity: number): void {
    this.#opacity = opacity;
    this.#draw();
  }

  #draw(): void {
    const { width, height } = this.#frame.getBoundingClientRect();
    const density = window.devicePixelRatio || 1;
    this.#overlay.width = Math.max(1, Math.round(width * density));
    this.#overlay.height = Math.max(1, Math.round(height * density));
    const context = contextOf(this.#overlay);
    context.scale(density, density);
    const layer = this.#painted[this.#layer];
    this.#scale.show(layer?.scale ?? null);
    if (layer) {
      context.globalAlpha = this.#opacity;
      context.imageSmoothingQuality = "high";
      context.drawImage(layer.pixels, 0, 0, width, height);
      context.globalAlpha = 1;
    }
    // An integer pixel is a pixel's centre, which lies half a pixel from the picture's edge.
    const place = ([u, v]: [number, number]): [number, number] => [
      ((u + 0.5) / this.#size.width) * width,
      ((v + 0.5) / this.#size.height) * height,
    ];
    if (this.#found) drawFound(context, ...place(this.#found));
    if (this.#truth) drawTruth(context, ...place(this.#truth));
  }
}

function painted({ heatmap, depthMap }: Localisation): Partial<Record<Layer, Painted>> {
  const layers: Partial<Record<Layer, Painted>> = {};
  if (heatmap) {
    const likelihood = { from: 0, to: rangeOf(heatmap.values).to };
    layers.heatmap = {
      pixels: canvasOf(coloured(heatmap, likelihood, (level) => Math.min(1, level / HEATMAP_OPAQUE_AT))),
      scale: { name: "Probability", ...likelihood, words: (value) => (value === 0 ? "0" : `${(100 * value).toPrecision(2)} %`) },
    };
  }
  if (depthMap) {
    const depth = rangeOf(depthMap.values);
    layers.depth = {
      pixels: canvasOf(coloured(depthMap, depth, () => 1)),
      scale: { name: "Depth", ...depth, words: (value) => `${value.toFixed(2)} m` },
    };
  }
  return layers;
}

function coloured({ values, width, height }: FloatMap, range: Parameters<typeof pixelsOf>[3], opacity: (level: number) => number): ImageData {
  return pixelsOf(values, width, height, range, opacity);
}

function canvasOf(image: ImageData): HTMLCanvasElement {
  const canvas = make("canvas");
  canvas.width = image.width;
  canvas.height = image.height;
  contextOf(canvas).putImageData(image, 0, 0);
  return canvas;
}
