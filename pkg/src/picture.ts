/** From whatever the caller holds to a message for the Worker. */
import { GravisightError, wordsOf } from "./error.js";
import type { PictureMessage } from "./protocol.js";
import type { DrawablePicture, Picture, Pixels } from "./types.js";

export interface PictureToSend {
  picture: PictureMessage;
  transfer: Transferable[];
}

/** Copies the caller's picture, so that nothing the caller holds is detached. */
export async function pictureToSend(source: Picture): Promise<PictureToSend> {
  if (source instanceof Blob) return encoded(await bytesOf(source));
  if (source instanceof ArrayBuffer) return encoded(new Uint8Array(source.slice(0)));
  if (source instanceof Uint8Array) return encoded(new Uint8Array(source));
  if (isPixels(source)) {
    const rgba = new Uint8Array(source.data);
    return { picture: { kind: "rgba", rgba, width: source.width, height: source.height }, transfer: [rgba.buffer] };
  }
  const bitmap = await bitmapOf(source);
  return { picture: { kind: "bitmap", bitmap }, transfer: [bitmap] };
}

/** An `ImageData`, or what looks like one where there is none. */
function isPixels(source: Picture): source is Pixels {
  return typeof source === "object" && "data" in source && ArrayBuffer.isView(source.data);
}

function encoded(bytes: Uint8Array<ArrayBuffer>): PictureToSend {
  return { picture: { kind: "encoded", bytes }, transfer: [bytes.buffer] };
}

async function bytesOf(blob: Blob): Promise<Uint8Array<ArrayBuffer>> {
  try {
    return new Uint8Array(await blob.arrayBuffer());
  } catch (thrown) {
    throw new GravisightError("image-read", `The picture's file could not be read: ${wordsOf(thrown)}.`, { cause: thrown });
  }
}

async function bitmapOf(source: DrawablePicture): Promise<ImageBitmap> {
  try {
    // Without conversion to the screen's colours: the core decodes files without one, too.
    return await createImageBitmap(source, { colorSpaceConversion: "none" });
  } catch (thrown) {
    throw new GravisightError("image-read", `The picture could not be drawn to pixels: ${wordsOf(thrown)}.`, { cause: thrown });
  }
}
