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
  /** Whether a person is to look whether the lines are right. */
  isAsked: boolean;
}

/** Numbers closer than this to one another could not be read, CSS pixels. */
const ROOM = 18;

export function paint(context: CanvasRenderingContext2D, toCanvas: PixelMap, scene: Scene): void {
  for (const { run, isFound } of scene.calibration?.lines ?? []) drawLine(context, run.map(toCanvas), isFound, scene.isAsked ? 2.5 : 1);
  for (const [index, point] of scene.points.entries()) {
    const put = scene.calibration?.put[index];
    if (put) drawPut(context, toCanvas(put), point.click ? toCanvas(point.click) : undefined);
  }
  const numbered: Pixel[] = [];
  for (const [index, { click }] of scene.points.entries()) {
    if (!click) continue;
    const at = toCanvas(click);
    if (!isSeen(at, context.canvas)) continue;
    const isWrong = scene.calibration?.outliers.has(index) ?? false;
    const isRead = index === scene.moved || isWrong || numbered.every(([x, y]) => Math.hypot(x - at[0], y - at[1]) > ROOM);
    if (isRead) numbered.push(at);
    drawClick(context, at, isRead ? String(index + 1) : "", index === scene.moved, isWrong);
  }
  if (scene.cross) drawCross(context, toCanvas(scene.cross));
}

/** Whether a mark is in the part of the picture that is shown. */
function isSeen([x, y]: Pixel, { clientWidth, clientHeight }: HTMLCanvasElement): boolean {
  return x > -ROOM && y > -ROOM && x < clientWidth + ROOM && y < clientHeight + ROOM;
}

/** A court's line where the camera puts it; one that the picture was not seen to show is dashed. */
function drawLine(context: CanvasRenderingContext2D, run: Pixel[], isFound: boolean, width: number): void {
  const path = new Path2D();
  for (const at of run) path.lineTo(...at);
  context.setLineDash(isFound ? [] : [3, 7]);
  stroke(context, path, PUT, width);
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
