/** From whatever the caller holds to a message for the Worker, and its end there. The core reads it. */
import { GravisightError, messageOf } from "./error.js";
import type { PictureMessage } from "./protocol.js";
import type { DrawablePicture, Picture, Pixels } from "./types.js";

export interface PictureToSend {
  picture: PictureMessage;
  transfer: Transferable[];
}

/**
 * Copies the caller's picture as it is now, so that nothing the caller holds is detached.
 *
 * @param memory where its pixels may go, if they are as many bytes: fresh memory costs more than the copy.
 */
export async function pictureToSend(source: Picture, memory?: Uint8Array<ArrayBuffer>): Promise<PictureToSend> {
  if (source instanceof Blob) return { picture: source, transfer: [] };
  if (source instanceof ArrayBuffer || source instanceof Uint8Array) {
    const bytes = source instanceof ArrayBuffer ? source.slice(0) : new Uint8Array(source).buffer;
    return { picture: bytes, transfer: [bytes] };
  }
  if (isPixels(source)) {
    let data = memory;
    if (data?.length === source.data.length) data.set(source.data);
    else data = new Uint8Array(source.data);
    return { picture: { data, width: source.width, height: source.height }, transfer: [data.buffer] };
  }
  const bitmap = await bitmapOf(source);
  return { picture: bitmap, transfer: [bitmap] };
}

/** Frees what the garbage collector would leave for long: a request's bitmaps, which are the engine's once they are sent. */
export function release(request: object): void {
  const { picture, pictures = [] } = request as { picture?: PictureMessage; pictures?: PictureMessage[] };
  for (const each of [picture, ...pictures]) if (each && "close" in each) each.close();
}

/** An `ImageData`, or what looks like one where there is none. */
function isPixels(source: Picture): source is Pixels {
  return typeof source === "object" && "data" in source && ArrayBuffer.isView(source.data);
}

/** Elements of a page cannot be sent, and a canvas is drawn on again. */
async function bitmapOf(source: DrawablePicture): Promise<ImageBitmap> {
  if (typeof createImageBitmap !== "function") {
    throw new GravisightError("image-read", "The picture could not be drawn to pixels: there is no browser here; give a PNG, JPEG or WebP file's bytes, or { data, width, height }.");
  }
  try {
    // Without conversion to the screen's colours: the core decodes files without one, too.
    return await createImageBitmap(source, { colorSpaceConversion: "none" });
  } catch (thrown) {
    throw new GravisightError("image-read", `The picture could not be drawn to pixels: ${messageOf(thrown)}.`, { cause: thrown });
  }
}
