/** Marks over pictures. Each has a dark edge, so that it is seen on any picture. Lengths are CSS pixels. */
import type { Pixel } from "./canvas";

const EDGE = "rgb(10 12 20 / 0.75)";
const FOUND = "#ff3d7f";
const TRUTH = "#ffffff";
const UPRIGHT = [[1, 0], [0, 1], [-1, 0], [0, -1]] as const;
const DIAGONAL = [[1, 1], [-1, 1], [-1, -1], [1, -1]] as const;

/** A ring with four ticks around it, which leaves the ball free to be seen. */
export function drawFound(context: CanvasRenderingContext2D, at: Pixel): void {
  const path = new Path2D();
  addRing(path, at, 15);
  addTicks(path, at, 19, 27);
  context.lineCap = "round";
  stroke(context, path, FOUND, 2.5);
}

/** A cross small enough to lie inside the ring. */
export function drawTruth(context: CanvasRenderingContext2D, at: Pixel): void {
  const path = new Path2D();
  addTicks(path, at, 0, 6);
  context.lineCap = "round";
  stroke(context, path, TRUTH, 2.5);
}

/** Four lines around the place that is aimed at. */
export function drawCross(context: CanvasRenderingContext2D, at: Pixel): void {
  const path = new Path2D();
  addTicks(path, at, 4, 14);
  stroke(context, path, TRUTH, 2);
}

/** Where the ball was: a line through all places, the older the paler. */
export function drawTrail(context: CanvasRenderingContext2D, places: Pixel[]): void {
  context.lineCap = "round";
  // All edges first: they would cut through the line where it turns.
  for (const [style, width] of [[EDGE, 4.5], [FOUND, 2]] as const) {
    context.strokeStyle = style;
    context.lineWidth = width;
    for (const [index, to] of places.entries()) {
      const from = places[index - 1];
      if (!from) continue;
      context.globalAlpha = index / places.length;
      context.stroke(new Path2D(`M${from.join(" ")}L${to.join(" ")}`));
    }
  }
  context.globalAlpha = 1;
}

/** Small numbered rings: places to choose from. */
export function drawNumbered(context: CanvasRenderingContext2D, places: readonly Pixel[]): void {
  const path = new Path2D();
  for (const place of places) addRing(path, place, 9);
  stroke(context, path, TRUTH, 2);
  context.font = "600 13px system-ui, sans-serif";
  for (const [index, [x, y]] of places.entries()) write(context, String(index + 1), [x + 10, y - 6], TRUTH);
}

/** A dashed frame, from one corner to the other. */
export function drawBox(context: CanvasRenderingContext2D, [left, top]: Pixel, [right, bottom]: Pixel): void {
  const path = new Path2D();
  path.rect(left, top, right - left, bottom - top);
  context.setLineDash([7, 5]);
  stroke(context, path, TRUTH, 2);
  context.setLineDash([]);
}

/** A circle that a person drew, and its middle. */
export function drawCircle(context: CanvasRenderingContext2D, at: Pixel, radius: number): void {
  const path = new Path2D();
  addRing(path, at, Math.max(radius, 1));
  if (radius > 12) addTicks(path, at, 0, 4);
  stroke(context, path, FOUND, 2);
}

export function addRing(path: Path2D, [x, y]: Pixel, radius: number): void {
  path.moveTo(x + radius, y);
  path.arc(x, y, radius, 0, 2 * Math.PI);
}

/** Four lines that point at a place. */
export function addTicks(path: Path2D, [x, y]: Pixel, from: number, to: number, isDiagonal = false): void {
  for (const [dx, dy] of isDiagonal ? DIAGONAL : UPRIGHT) {
    path.moveTo(x + dx * from, y + dy * from);
    path.lineTo(x + dx * to, y + dy * to);
  }
}

export function stroke(context: CanvasRenderingContext2D, path: Path2D, colour: string, width = 2): void {
  for (const [style, line] of [[EDGE, width + 2.5], [colour, width]] as const) {
    context.strokeStyle = style;
    context.lineWidth = line;
    context.stroke(path);
  }
}

/** Text whose lower edge is at `at`. */
export function write(context: CanvasRenderingContext2D, text: string, at: Pixel, colour: string): void {
  context.textBaseline = "bottom";
  context.lineJoin = "round";
  context.strokeStyle = EDGE;
  context.lineWidth = 4;
  context.strokeText(text, ...at);
  context.fillStyle = colour;
  context.fillText(text, ...at);
}
