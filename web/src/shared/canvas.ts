/** Pictures and canvases: decoded, drawn over, saved. */
import { contextOf, make } from "../dom";

export type Pixel = [number, number];
/** Maps pixels of the picture to where they are drawn. */
export type PixelMap = (pixel: Pixel) => Pixel;

interface Size {
  width: number;
  height: number;
}

/** Empties a canvas that covers a picture of `size`, at the screen's own sharpness: to be drawn on in CSS pixels. */
export function overlayOf(canvas: HTMLCanvasElement, size: Size): Size & { context: CanvasRenderingContext2D; toCanvas: PixelMap } {
  const { width, height } = canvas.getBoundingClientRect();
  const density = window.devicePixelRatio || 1;
  canvas.width = Math.max(1, Math.round(width * density));
  canvas.height = Math.max(1, Math.round(height * density));
  const context = contextOf(canvas);
  context.scale(density, density);
  // An integer pixel is a pixel's centre, which lies half a pixel from the picture's edge.
  return { context, width, height, toCanvas: ([u, v]) => [((u + 0.5) / size.width) * width, ((v + 0.5) / size.height) * height] };
}

/** A canvas of these pixels. */
export function canvasOf(image: ImageData): HTMLCanvasElement {
  const canvas = make("canvas");
  canvas.width = image.width;
  canvas.height = image.height;
  contextOf(canvas).putImageData(image, 0, 0);
  return canvas;
}

/** What is shown as a picture file, without loss. */
export function pictureFile(image: CanvasImageSource, { width, height }: Size): Promise<Blob> {
  const canvas = make("canvas");
  canvas.width = width;
  canvas.height = height;
  contextOf(canvas).drawImage(image, 0, 0, width, height);
  return blobOf(canvas, "image/png");
}

/** How a frame is kept: PNG where it is small, so that nothing is lost; else WebP, for the browser's room. */
export function keptAs({ width, height }: Size): "image/png" | "image/webp" {
  return width * height <= 640 * 480 ? "image/png" : "image/webp";
}

/** A canvas as a picture file. */
export function blobOf(canvas: HTMLCanvasElement, type: "image/png" | "image/webp"): Promise<Blob> {
  return new Promise((resolve, reject) => {
    canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("This browser could not make a picture file."))), type, 0.95);
  });
}

/** Decodes a picture file; throws an error with a message for people. */
export async function decode(picture: Blob, name: string): Promise<ImageBitmap> {
  try {
    return await createImageBitmap(picture, { colorSpaceConversion: "none" });
  } catch {
    throw new Error(`${name} is not a picture that this browser can read. Use PNG, JPEG or WebP.`);
  }
}
