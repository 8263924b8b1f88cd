/** The picture, large, with the network's maps and the two positions drawn over it. */
import type { Localisation } from "gravisight";
import { contextOf, element, make } from "./dom";
import { overlayOf, type Pixel } from "./shared/canvas";
import { drawMap, mapOf, type ColouredMap, type Layer } from "./shared/maps";
import { drawFound, drawTruth } from "./shared/marks";
import { ScaleBar } from "./shared/scale";

/** No picture is kept larger than this: no screen shows more. In pixels. */
const LARGEST_SIDE = 1600;

export class Stage {
  readonly #frame = element("frame");
  readonly #picture = element<HTMLCanvasElement>("picture");
  readonly #overlay = element<HTMLCanvasElement>("overlay");
  readonly #scale = new ScaleBar(element("scale"));
  readonly #key = element("key");
  /** Of the picture as it was given, in pixels. */
  #size = { width: 1, height: 1 };
  #result: Localisation | undefined;
  #truth: Pixel | undefined;
  #map: ColouredMap | undefined;
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
  showResult(result: Localisation, truth: Pixel | undefined): void {
    this.#result = result;
    this.#truth = truth;
    const [u, v] = result.image.map((x) => x.toFixed(1));
    this.#overlay.setAttribute("aria-label", `The ball was found at pixel ${u}, ${v}, ${result.depth.toFixed(2)} metres from the camera`);
    const entries = [make("span", { class: "key-found", text: "Found" })];
    if (truth) entries.push(make("span", { class: "key-truth", text: "True position" }));
    this.#key.replaceChildren(...entries);
    this.#colour();
  }

  /** Removes the result; the picture stays. */
  clear(): void {
    this.#result = this.#truth = undefined;
    this.#key.replaceChildren();
    this.#overlay.setAttribute("aria-label", "Nothing found yet");
    this.#colour();
  }

  setLayer(layer: Layer): void {
    this.#layer = layer;
    this.#colour();
  }

  setOpacity(opacity: number): void {
    this.#opacity = opacity;
    this.#draw();
  }

  #colour(): void {
    this.#map = mapOf(this.#result ?? {}, this.#layer);
    this.#scale.show(this.#map?.scale ?? null);
    this.#draw();
  }

  #draw(): void {
    const { context, width, height, place } = overlayOf(this.#overlay, this.#size);
    if (this.#map) drawMap(context, this.#map, width, height, this.#opacity);
    if (this.#result) drawFound(context, place(this.#result.image));
    if (this.#truth) drawTruth(context, place(this.#truth));
  }
}
