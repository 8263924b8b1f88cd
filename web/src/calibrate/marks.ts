/** What is drawn over the picture: clicks, where the camera puts the points, and what lies between. */
import type { Pixel, PixelMap } from "../shared/canvas";
import { addRing, addTicks, stroke, write } from "../shared/marks";
import type { Calibration } from "./calibration";
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
  calibration: Calibration | undefined;
}

export function paint(context: CanvasRenderingContext2D, toCanvas: PixelMap, scene: Scene): void {
  for (const { run, isFound } of scene.calibration?.lines ?? []) drawLine(context, run.map(toCanvas), isFound);
  for (const [index, point] of scene.points.entries()) {
    const put = scene.calibration?.put[index];
    if (put) drawPut(context, toCanvas(put), point.click ? toCanvas(point.click) : undefined);
  }
  for (const [index, { click }] of scene.points.entries()) {
    if (click) drawClick(context, toCanvas(click), String(index + 1), index === scene.moved, scene.calibration?.outliers.has(index) ?? false);
  }
  if (scene.cross) drawCross(context, toCanvas(scene.cross));
}

/** A court's line where the camera puts it; one that the picture was not seen to show is dashed. */
function drawLine(context: CanvasRenderingContext2D, run: Pixel[], isFound: boolean): void {
  const path = new Path2D();
  for (const at of run) path.lineTo(...at);
  context.setLineDash(isFound ? [] : [3, 7]);
  stroke(context, path, PUT, 1);
  context.setLineDash([]);
}

function drawPut(context: CanvasRenderingContext2D, at: Pixel, click: Pixel | undefined): void {
  const path = new Path2D();
  if (click) {
    path.moveTo(...click);
    path.lineTo(...at);
  }
  addRing(path, at, 4);
  stroke(context, path, PUT, 1.5);
}

function drawClick(context: CanvasRenderingContext2D, at: Pixel, number: string, current: boolean, wrong: boolean): void {
  const path = new Path2D();
  // The middle stays free, so that the point itself is seen.
  addTicks(path, at, 2, 8, wrong);
  if (current) addRing(path, at, 12);
  const colour = wrong ? WRONG : current ? CURRENT : CLICK;
  stroke(context, path, colour);
  context.font = "600 13px system-ui, sans-serif";
  const text = wrong ? `${number} wrong click?` : number;
  const [x, y] = at;
  const left = x + 10 + context.measureText(text).width > context.canvas.clientWidth;
  context.textAlign = left ? "right" : "left";
  write(context, text, [x + (left ? -9 : 9), Math.max(16, y - 5)], colour);
}

function drawCross(context: CanvasRenderingContext2D, at: Pixel): void {
  const path = new Path2D();
  addTicks(path, at, 3, 16);
  stroke(context, path, CURRENT, 1.5);
}
