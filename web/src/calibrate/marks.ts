/** What is drawn over the picture: clicks, where the camera puts the points, and what lies between. */
import type { CalibrationResult } from "gravisight";
import { strokeOn, type Pixel, type Place } from "../shared/picture-view";
import type { Point } from "./state";

const CLICK = "#ffd54a";
const CURRENT = "#ff3d7f";
const WRONG = "#ff7a5c";
const PUT = "#5ce1ff";

export interface Scene {
  points: Point[];
  /** The point that keys move. */
  moved: number | undefined;
  /** Where keys would place the next point. */
  cross: Pixel | undefined;
  /** Where the camera puts each point; null where it cannot see it. */
  put: (Pixel | null)[];
  outliers: Set<number>;
  residuals: Map<number, CalibrationResult["residuals_px"][number]>;
}

export function paint(context: CanvasRenderingContext2D, place: Place, scene: Scene): void {
  for (const [index, point] of scene.points.entries()) {
    const put = scene.put[index];
    if (put) drawPut(context, place(put), point.click ? place(point.click) : undefined);
  }
  for (const [index, { click }] of scene.points.entries()) {
    if (click) drawClick(context, place(click), String(index + 1), index === scene.moved, scene.outliers.has(index));
  }
  if (scene.cross) drawCross(context, place(scene.cross));
}

function drawPut(context: CanvasRenderingContext2D, [x, y]: Pixel, click: Pixel | undefined): void {
  const path = new Path2D();
  if (click) {
    path.moveTo(...click);
    path.lineTo(x, y);
  }
  path.moveTo(x + 4, y);
  path.arc(x, y, 4, 0, 2 * Math.PI);
  strokeOn(context, path, PUT, 1.5);
}

function drawClick(context: CanvasRenderingContext2D, [x, y]: Pixel, number: string, current: boolean, wrong: boolean): void {
  const path = new Path2D();
  for (const [dx, dy] of wrong ? [[1, 1], [1, -1], [-1, 1], [-1, -1]] : [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    // The middle stays free, so that the point itself is seen.
    path.moveTo(x + 2 * (dx ?? 0), y + 2 * (dy ?? 0));
    path.lineTo(x + 8 * (dx ?? 0), y + 8 * (dy ?? 0));
  }
  if (current) {
    path.moveTo(x + 12, y);
    path.arc(x, y, 12, 0, 2 * Math.PI);
  }
  const colour = wrong ? WRONG : current ? CURRENT : CLICK;
  strokeOn(context, path, colour);
  context.font = "600 13px system-ui, sans-serif";
  context.textBaseline = "bottom";
  context.lineJoin = "round";
  context.strokeStyle = "rgb(10 12 20 / 0.85)";
  context.lineWidth = 4;
  const words = wrong ? `${number} wrong click?` : number;
  const left = x + 10 + context.measureText(words).width > context.canvas.clientWidth;
  context.textAlign = left ? "right" : "left";
  const at = [x + (left ? -9 : 9), Math.max(16, y - 5)] as const;
  context.strokeText(words, ...at);
  context.fillStyle = colour;
  context.fillText(words, ...at);
}

function drawCross(context: CanvasRenderingContext2D, [x, y]: Pixel): void {
  const path = new Path2D();
  for (const [dx, dy] of [[1, 0], [0, 1], [-1, 0], [0, -1]] as const) {
    path.moveTo(x + dx * 3, y + dy * 3);
    path.lineTo(x + dx * 16, y + dy * 16);
  }
  strokeOn(context, path, CURRENT, 1.5);
}
