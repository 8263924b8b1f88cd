/** What was found, as text, as JSON and as a picture. */
import type { DrawnCircle } from "gravisight";
import { contextOf, make } from "../dom";
import { blobOf, type Pixel } from "../shared/canvas";
import { drawCircle, drawFound } from "../shared/marks";
import type { Place } from "./place";
import type { Subject } from "./subject";

/** A position for a message or a spreadsheet's cells: a line for each number, with a tab before it. */
export function textOf({ world, depth, depthSigma, sigma, image, how }: Place, { name }: Subject): string {
  const lines: [string, string][] = [
    ["Picture", name],
    ["Found by", how],
    ...(["x", "y", "z"] as const).map((axis, index): [string, string] => [`${axis}, m`, world[index]!.toFixed(4)]),
    ["Uncertainty (1-σ), m", sigma?.toFixed(4) ?? ""],
    ["Depth, m", depth.toFixed(4)],
    ["Depth (1-σ), m", depthSigma?.toFixed(4) ?? ""],
    ["In the picture, px", image.map((px) => px.toFixed(2)).join(" ")],
  ];
  return `${lines.filter(([, value]) => value).map((line) => line.join("\t")).join("\n")}\n`;
}

/** Everything that the position was computed from, too. */
export function jsonOf({ how, circle, ...place }: Place, { name, camera, oneSigma = [], note }: Subject, radius: number): string {
  const about = { source: name, units: "metres, pixels; world z up", found_by: how };
  const from = { ball: { radius }, camera, one_sigma: oneSigma, ...(note && { note }), ...(circle && { circle }) };
  return `${JSON.stringify({ ...about, ...place, ...from }, null, 1)}\n`;
}

/** The picture at its own size, with the ring as large as on the screen, or the circle that was drawn. */
export async function pictureOf(picture: Blob, image: Pixel, circle: DrawnCircle | undefined, shownWidth: number): Promise<Blob> {
  const bitmap = await createImageBitmap(picture);
  const canvas = make("canvas");
  canvas.width = bitmap.width;
  canvas.height = bitmap.height;
  const context = contextOf(canvas);
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const scale = canvas.width / Math.max(1, shownWidth);
  context.scale(scale, scale);
  // An integer pixel is a pixel's centre.
  const at = ([u, v]: Pixel): Pixel => [(u + 0.5) / scale, (v + 0.5) / scale];
  if (circle) drawCircle(context, at(circle.centre), circle.radiusPx / scale);
  else drawFound(context, at(image));
  return blobOf(canvas, "image/png");
}
