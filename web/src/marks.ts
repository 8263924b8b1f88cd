/** The marks of the found and of the true position. Each has a dark edge, so that it is seen on any picture. */

/** All in CSS pixels. */
const RING_RADIUS = 15;
const TICK = { from: 19, to: 27 };
const CROSS = 6;
const LINE_WIDTH = 2.5;
const EDGE_WIDTH = 5;
const EDGE = "rgb(10 12 20 / 0.75)";
export const FOUND = "#ff3d7f";
export const TRUTH = "#ffffff";

/** A ring with four ticks around it, which leaves the ball free to be seen. */
export function drawFound(context: CanvasRenderingContext2D, x: number, y: number): void {
  const path = new Path2D();
  path.arc(x, y, RING_RADIUS, 0, 2 * Math.PI);
  for (const [dx, dy] of [[1, 0], [0, 1], [-1, 0], [0, -1]] as const) {
    path.moveTo(x + dx * TICK.from, y + dy * TICK.from);
    path.lineTo(x + dx * TICK.to, y + dy * TICK.to);
  }
  strokeWithEdge(context, path, FOUND);
}

/** A cross small enough to lie inside the ring. */
export function drawTruth(context: CanvasRenderingContext2D, x: number, y: number): void {
  const path = new Path2D();
  path.moveTo(x - CROSS, y);
  path.lineTo(x + CROSS, y);
  path.moveTo(x, y - CROSS);
  path.lineTo(x, y + CROSS);
  strokeWithEdge(context, path, TRUTH);
}

function strokeWithEdge(context: CanvasRenderingContext2D, path: Path2D, colour: string): void {
  context.lineCap = "round";
  context.strokeStyle = EDGE;
  context.lineWidth = EDGE_WIDTH;
  context.stroke(path);
  context.strokeStyle = colour;
  context.lineWidth = LINE_WIDTH;
  context.stroke(path);
}
