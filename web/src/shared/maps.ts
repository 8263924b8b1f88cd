/** The network's maps in colours, with the scales that say what the colours mean. */
import type { FloatMap, Localisation } from "gravisight";
import { canvasOf } from "./canvas";
import { pixelsOf, rangeOf } from "./colourmap";
import type { Scale } from "./scale";

export type Layer = "none" | "heatmap" | "depth" | "saliency";

/** Cells of the heatmap reach full opacity at this part of its peak, so that its flanks are seen and its feet are not. */
const HEATMAP_OPAQUE_AT = 0.4;

export interface ColouredMap {
  pixels: HTMLCanvasElement;
  scale: Scale;
}

/** A layer of what was found; undefined where that has none. */
export function mapOf({ heatmap, depthMap, saliency }: Pick<Partial<Localisation>, "heatmap" | "depthMap" | "saliency">, layer: Layer): ColouredMap | undefined {
  if (layer === "heatmap" && heatmap) {
    const range = { from: 0, to: rangeOf(heatmap.values).to };
    const format = (value: number) => (value === 0 ? "0" : `${(100 * value).toPrecision(2)} %`);
    return { pixels: coloured(heatmap, range, (level) => Math.min(1, level / HEATMAP_OPAQUE_AT)), scale: { name: "Probability", ...range, format } };
  }
  if (layer === "depth" && depthMap) {
    const range = rangeOf(depthMap.values);
    return { pixels: coloured(depthMap, range, () => 1), scale: { name: "Depth", ...range, format: (value) => `${value.toFixed(2)} m` } };
  }
  if (layer === "saliency" && saliency) {
    // How much, whichever way.
    const strength = { ...saliency, values: saliency.values.map(Math.abs) };
    const range = { from: 0, to: rangeOf(strength.values).to };
    const format = (value: number) => (value === 0 ? "0" : `${value.toPrecision(2)} m`);
    return { pixels: coloured(strength, range, (level) => Math.min(1, 0.15 + 2 * level)), scale: { name: "Depth changes by", ...range, format } };
  }
  return undefined;
}

/** Draws a map over all of a picture. */
export function drawMap(context: CanvasRenderingContext2D, { pixels }: ColouredMap, width: number, height: number, opacity: number): void {
  context.globalAlpha = opacity;
  context.imageSmoothingQuality = "high";
  context.drawImage(pixels, 0, 0, width, height);
  context.globalAlpha = 1;
}

function coloured({ values, width, height }: FloatMap, range: { from: number; to: number }, opacity: (level: number) => number): HTMLCanvasElement {
  return canvasOf(pixelsOf(values, width, height, range, opacity));
}
