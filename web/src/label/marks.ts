/** The label of a frame, or what is proposed, over its picture. */
import type { PixelMap } from "../shared/canvas";
import { addRing, addTicks, stroke, write } from "../shared/marks";
import type { FrameState, Labelling } from "./labelling";

const COLOURS: Record<FrameState, string> = {
  sure: "#5ce1ff",
  doubtful: "#ffb547",
  accepted: "#62e39d",
  corrected: "#d49bff",
  hidden: "#ffffff",
  open: "#ffffff",
};
/** The ring is never smaller than this, CSS pixels. */
const LEAST_RING = 9;
/** Radius where nobody has measured it, picture pixels. */
const USUAL_RADIUS = 5;

export function paint(context: CanvasRenderingContext2D, toCanvas: PixelMap, labelling: Labelling): void {
  const state = labelling.state();
  const at = labelling.at();
  if (state === "hidden") {
    context.font = "600 15px system-ui, sans-serif";
    return write(context, "ball not visible", [14, context.canvas.clientHeight - 12], COLOURS.hidden);
  }
  if (!at) return;
  const centre = toCanvas(at);
  const [edge] = toCanvas([at[0] + (labelling.proposal()?.radiusPx ?? USUAL_RADIUS), at[1]]);
  const radius = Math.max(LEAST_RING, edge - centre[0] + 2);
  const path = new Path2D();
  addRing(path, centre, radius);
  addTicks(path, centre, radius + 3, radius + 10);
  // Dashes say that nobody has looked yet.
  context.setLineDash(state === "sure" || state === "doubtful" ? [6, 4] : []);
  stroke(context, path, COLOURS[state]);
  context.setLineDash([]);
}
