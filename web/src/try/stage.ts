/** The picture, large, with the network's maps and the two positions drawn over it. */
import type { Localisation, Region } from "gravisight";
import { element, make } from "../dom";
import type { Pixel } from "../shared/canvas";
import type { Layer } from "../shared/maps";
import { Overlay } from "../shared/overlay";

/** A result over its picture. */
interface ShownResult {
  result: Localisation;
  truth: Pixel | undefined;
  region: Region | undefined;
  /** Index of the place that a person chose. */
  chosen: number | undefined;
}

export class Stage {
  readonly #overlay = new Overlay(element("frame"), element<HTMLCanvasElement>("picture"), element<HTMLCanvasElement>("overlay"), element("scale"));
  readonly #key = element("key");
  #shown: ShownResult | undefined;
  #layer: Layer = "none";

  /** Shows a picture without a result; false where the browser cannot read it. */
  async showPicture(picture: Blob, isCurrent: () => boolean): Promise<boolean> {
    const bitmap = await createImageBitmap(picture).catch(() => null);
    if (!isCurrent()) return bitmap !== null;
    this.#overlay.setSize(bitmap?.width ?? 1, bitmap?.height ?? 1);
    if (bitmap) this.#overlay.showPlain(bitmap, "");
    bitmap?.close();
    this.clear();
    return bitmap !== null;
  }

  /** Shows what was found, over the picture. */
  showResult(shown: ShownResult): void {
    const { result, truth, chosen } = shown;
    this.#shown = shown;
    const found = chosen !== undefined ? "Your choice" : result.ballFound ? "Found" : "Likeliest position";
    const entries = [make("span", { class: "key-found", text: found })];
    if (truth) entries.push(make("span", { class: "key-truth", text: "True position" }));
    this.#key.replaceChildren(...entries);
    this.setLayer(this.#layer);
  }

  /** Removes the result; the picture stays. */
  clear(): void {
    this.#shown = undefined;
    this.#key.replaceChildren();
    this.#overlay.clear("Nothing found yet");
  }

  setLayer(layer: Layer): void {
    this.#layer = layer;
    if (!this.#shown) return;
    const { result, truth, region, chosen } = this.#shown;
    const place = chosen === undefined ? undefined : result.candidates?.[chosen];
    // Where the ball was found they would only hide the picture.
    const numbered = result.ballFound && !place ? [] : (result.candidates?.map(({ image }) => image) ?? []);
    this.#overlay.show({ ...result, ...place }, { layer, sure: result.ballFound || place !== undefined, truth, numbered, region });
  }

  setOpacity(opacity: number): void {
    this.#overlay.setOpacity(opacity);
  }
}
