/** The picture, large, with the network's maps and the two positions drawn over it. */
import type { Localisation } from "gravisight";
import { element, make } from "../dom";
import type { Pixel } from "../shared/canvas";
import type { Layer } from "../shared/maps";
import { Overlay } from "../shared/overlay";

export class Stage {
  readonly #overlay = new Overlay(element("frame"), element<HTMLCanvasElement>("picture"), element<HTMLCanvasElement>("overlay"), element("scale"));
  readonly #key = element("key");
  #shown: { result: Localisation; truth: Pixel | undefined } | undefined;
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
  showResult(result: Localisation, truth: Pixel | undefined): void {
    this.#shown = { result, truth };
    const entries = [make("span", { class: "key-found", text: result.ballFound ? "Found" : "Likeliest position" })];
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
    if (this.#shown) this.#overlay.show(this.#shown.result, { layer, sure: this.#shown.result.ballFound, truth: this.#shown.truth });
  }

  setOpacity(opacity: number): void {
    this.#overlay.setOpacity(opacity);
  }
}
