/** The place from above, drawn: its lines, and each bounce with the ellipse that holds it. What is where the core says. */
import type { Plan } from "gravisight";

const SVG = "http://www.w3.org/2000/svg";
/** Standard deviations that an ellipse is drawn at: it holds the place with a probability of 86 %. */
const SIGMAS = 2;
/** Of the longer side: height of a number, radius of a dot. */
const TEXT = 0.036;
const DOT = 0.007;

/** `times`: when each bounce is, s, by its number from 1. */
export function planOf(plan: Plan, times: Map<number, number>): SVGSVGElement {
  const [[left, bottom], [right, top]] = [plan.low, plan.high];
  const [width, height] = [right - left, top - bottom];
  const longer = Math.max(width, height);
  // Rows count downwards there, y upwards here.
  const drawing = element("svg", { class: "plan", viewBox: [left, -top, width, height].join(" "), role: "img", "aria-label": descriptionOf(plan) });
  for (const line of plan.lines) drawing.append(element("polyline", { points: line.map(([x, y]) => `${x},${-y}`).join(" ") }));
  for (const { bounce, at: [x, y], sigma: [a, b], angle } of plan.bounces) {
    const degrees = (-180 * angle) / Math.PI;
    const number = element("text", { x: x + 1.6 * DOT * longer, y: -y - 1.6 * DOT * longer, "font-size": TEXT * longer });
    number.textContent = String(bounce);
    const group = element("g", { "data-time": times.get(bounce) ?? "" });
    group.append(
      element("ellipse", { cx: x, cy: -y, rx: SIGMAS * a, ry: SIGMAS * b, transform: `rotate(${degrees} ${x} ${-y})` }),
      element("circle", { cx: x, cy: -y, r: DOT * longer }),
      number,
    );
    drawing.append(group);
  }
  return drawing;
}

function descriptionOf({ bounces }: Plan): string {
  const each = bounces.map(({ bounce, at: [x, y] }) => `bounce ${bounce} at x ${x.toFixed(1)}, y ${y.toFixed(1)} metres`);
  return `The place from above: ${each.join("; ")}`;
}

function element<K extends keyof SVGElementTagNameMap>(name: K, attributes: Record<string, string | number>): SVGElementTagNameMap[K] {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  return made;
}
