/** From what arrives at the engine to what the core reads. */
import { GravisightError, wordsOf } from "./error.js";
import type { PictureMessage } from "./protocol.js";

export type Encoded = Extract<PictureMessage, { kind: "encoded" }>;
export type Rgba = Extract<PictureMessage, { kind: "rgba" }>;

/** What pictures are given to, one after the other. */
interface Collector {
  addPicture(rgba: Uint8Array, width: number, height: number): void;
  addFile(file: Uint8Array): void;
}

/** One canvas for all frames: a new one each would be kept until the next garbage collection. */
let canvas: OffscreenCanvas | undefined;

export function pixelsOf(picture: PictureMessage): Encoded | Rgba {
  return picture.kind === "bitmap" ? drawn(picture.bitmap) : picture;
}

/** Gives a picture to what collects them. */
export function addPicture(to: Collector, picture: PictureMessage): void {
  const input = pixelsOf(picture);
  if (input.kind === "encoded") to.addFile(input.bytes);
  else to.addPicture(input.rgba, input.width, input.height);
}

function drawn(bitmap: ImageBitmap): Rgba {
  const { width, height } = bitmap;
  try {
    if (!canvas || canvas.width !== width || canvas.height !== height) canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    if (!context) throw new Error("this browser gives no 2D canvas here");
    context.clearRect(0, 0, width, height);
    context.drawImage(bitmap, 0, 0);
    const rgba = new Uint8Array(context.getImageData(0, 0, width, height).data.buffer);
    return { kind: "rgba", rgba, width, height };
  } catch (thrown) {
    throw new GravisightError("image-read", `The picture could not be drawn to pixels: ${wordsOf(thrown)}.`, { cause: thrown });
  } finally {
    bitmap.close();
  }
}
