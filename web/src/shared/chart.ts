/** A plot over time, drawn as SVG: dots for single frames, lines for what is smooth. */

export interface Series {
  name: string;
  /** A CSS colour, may be a variable. */
  colour: string;
  /** Seconds and value. */
  line?: [number, number][];
  dots?: { at: [number, number]; faint: boolean }[];
}

export interface Content {
  /** In words, with the unit: `Position (m)`. */
  title: string;
  series: Series[];
  /** What runs to the right, if it is not time in seconds. */
  axis?: string;
  /** Seconds to mark. */
  marks?: number[];
  /** Seconds. */
  from: number;
  to: number;
}

const MARGIN = { left: 46, right: 26, top: 26, bottom: 36 };
const SVG = "http://www.w3.org/2000/svg";
const FONT = "12px system-ui, sans-serif";
/** More than these are not told apart. */
const MOST_DOTS = 1200;

export class Chart {
  readonly svg = document.createElementNS(SVG, "svg");
  #content: Content | undefined;
  readonly #observer: ResizeObserver;

  constructor(place: HTMLElement, testId: string) {
    this.svg.dataset.testid = testId;
    place.append(this.svg);
    this.#observer = new ResizeObserver(() => this.#draw());
    this.#observer.observe(place);
  }

  show(content: Content): void {
    this.#content = content;
    this.#draw();
  }

  #draw(): void {
    const place = this.svg.parentElement;
    const content = this.#content;
    if (!place?.clientWidth || !content) return;
    const width = place.clientWidth;
    const height = Math.round(Math.min(300, Math.max(190, width * 0.42)));
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.setAttribute("width", String(width));
    this.svg.setAttribute("height", String(height));
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("aria-label", described(content));
    this.svg.replaceChildren(...parts(content, width, height));
  }
}

function parts({ title, series, axis = "time (s)", marks = [], from, to }: Content, width: number, height: number): SVGElement[] {
  const values = series.flatMap(({ line = [], dots = [] }) => [...line.map(([, value]) => value), ...dots.map(({ at }) => at[1])]);
  const rows = ticks(values.length ? Math.min(...values) : 0, values.length ? Math.max(...values) : 1, Math.max(2, Math.floor(height / 50)));
  const columns = ticks(from, Math.max(to, from + 0.1), Math.max(2, Math.floor(width / 90)));
  const low = rows[0]!;
  const high = rows.at(-1)!;
  const end = Math.max(to, from + 0.1);
  const x = (t: number) => MARGIN.left + ((t - from) / (end - from)) * (width - MARGIN.left - MARGIN.right);
  const y = (value: number) => height - MARGIN.bottom - ((value - low) / (high - low)) * (height - MARGIN.top - MARGIN.bottom);
  const made: SVGElement[] = [text(title, 0, 14, { fill: "var(--ink)", "font-weight": "600" })];
  for (const row of rows) {
    made.push(line([[MARGIN.left, y(row)], [width - MARGIN.right, y(row)]], "var(--line)", 1));
    made.push(text(words(row, rows), MARGIN.left - 8, y(row) + 4, { "text-anchor": "end" }));
  }
  for (const column of columns.filter((t) => t >= from - 1e-9 && t <= end + 1e-9)) {
    made.push(line([[x(column), height - MARGIN.bottom], [x(column), height - MARGIN.bottom + 5]], "var(--quiet)", 1));
    made.push(text(words(column, columns), x(column), height - MARGIN.bottom + 18, { "text-anchor": "middle" }));
  }
  made.push(text(axis, width - MARGIN.right, height - 3, { "text-anchor": "end" }));
  for (const mark of marks) {
    const path = line([[x(mark), MARGIN.top - 4], [x(mark), height - MARGIN.bottom]], "var(--busy)", 1.5);
    path.setAttribute("stroke-dasharray", "4 3");
    made.push(path);
  }
  const names: { name: string; colour: string; at: number }[] = [];
  for (const { name, colour, line: smooth = [], dots = [] } of series) {
    const stride = Math.ceil(dots.length / MOST_DOTS);
    const disc = (faint: boolean) =>
      dots
        .filter((dot, index) => index % stride === 0 && dot.faint === faint)
        // A line of no length with round ends is a dot, and all of them are one element.
        .map(({ at: [t, value] }) => `M${x(t).toFixed(1)} ${y(value).toFixed(1)}h0`)
        .join("");
    made.push(element("path", { d: disc(false), stroke: colour, "stroke-width": "4.5", "stroke-linecap": "round", fill: "none", "data-series": name }));
    made.push(element("path", { d: disc(true), stroke: colour, "stroke-width": "3", "stroke-linecap": "round", "stroke-opacity": "0.35", fill: "none" }));
    if (smooth.length > 1) made.push(line(smooth.map(([t, value]) => [x(t), y(value)]), colour, 2));
    const last = smooth.at(-1) ?? dots.at(-1)?.at;
    if (last && name) names.push({ name, colour, at: y(last[1]) });
  }
  // Beside the lines' ends, and not over each other.
  names.sort((a, b) => a.at - b.at);
  names.forEach((entry, index) => {
    const before = names[index - 1];
    if (before) entry.at = Math.max(entry.at, before.at + 14);
    made.push(text(entry.name, width - MARGIN.right + 8, entry.at + 4, { fill: entry.colour, "font-weight": "700" }));
  });
  return made;
}

/** Round numbers, from below `from` to above `to`. */
function ticks(from: number, to: number, most: number): number[] {
  const span = to - from || Math.abs(to) || 1;
  const rough = span / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= rough) ?? 10);
  const first = Math.floor(from / step + 1e-9);
  const last = Math.max(Math.ceil(to / step - 1e-9), first + 1);
  return Array.from({ length: last - first + 1 }, (_, index) => (first + index) * step);
}

function words(value: number, all: number[]): string {
  const step = (all[1] ?? 1) - (all[0] ?? 0);
  return value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");
}

function described({ title, series, axis = "time (s)", marks = [], from, to }: Content): string {
  const shown = series.flatMap(({ name, line: smooth = [], dots = [] }) => {
    const values = [...smooth.map(([, value]) => value), ...dots.map(({ at }) => at[1])];
    return values.length ? [`${name} from ${Math.min(...values).toFixed(2)} to ${Math.max(...values).toFixed(2)}`.trim()] : [];
  });
  if (shown.length === 0) return `${title} over time: nothing yet`;
  const bounces = marks.length ? `; marked at ${marks.map((t) => t.toFixed(2)).join(", ")} s` : "";
  return `${title} over ${from.toFixed(1)} to ${to.toFixed(1)} of ${axis}: ${shown.join(", ")}${bounces}`;
}

function line(points: [number, number][], colour: string, width: number): SVGElement {
  const d = points.map(([x, y], index) => `${index ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
  return element("path", { d, stroke: colour, "stroke-width": String(width), "stroke-linejoin": "round", fill: "none" });
}

function text(content: string, x: number, y: number, attributes: Record<string, string> = {}): SVGElement {
  const made = element("text", { x: x.toFixed(1), y: y.toFixed(1), fill: "var(--quiet)", style: `font:${FONT}`, ...attributes });
  if (attributes["font-weight"]) made.style.fontWeight = attributes["font-weight"];
  made.textContent = content;
  return made;
}

function element(name: string, attributes: Record<string, string>): SVGElement {
  const made = document.createElementNS(SVG, name);
  for (const [attribute, value] of Object.entries(attributes)) made.setAttribute(attribute, value);
  return made;
}

/** The variables that the plots' colours come from. */
const VARIABLES = ["--ink", "--quiet", "--line", "--busy", "--accent", "--axis-x", "--axis-y", "--axis-z", "--card"];
/** Of the saved picture, by screen pixels. */
const SHARPNESS = 2;

/** The plots, one below the other, as a PNG. */
export async function pictureOf(charts: Chart[]): Promise<Blob> {
  const canvas = document.createElement("canvas");
  const sizes = charts.map(({ svg }) => svg.viewBox.baseVal);
  const PADDING = 16;
  canvas.width = SHARPNESS * (Math.max(...sizes.map(({ width }) => width)) + 2 * PADDING);
  canvas.height = SHARPNESS * sizes.reduce((sum, { height }) => sum + height + PADDING, PADDING);
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser gives no 2D canvas");
  context.scale(SHARPNESS, SHARPNESS);
  let top = PADDING;
  for (const { svg } of charts) {
    const style = getComputedStyle(svg);
    context.fillStyle = style.getPropertyValue("--card").trim() || "#fff";
    if (top === PADDING) context.fillRect(0, 0, canvas.width, canvas.height);
    const copy = svg.cloneNode(true) as SVGSVGElement;
    // Alone, the picture knows none of the page's colours.
    for (const name of VARIABLES) copy.style.setProperty(name, style.getPropertyValue(name).trim());
    const image = new Image();
    image.src = `data:image/svg+xml,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
    await image.decode();
    context.drawImage(image, PADDING, top);
    top += svg.viewBox.baseVal.height + PADDING;
  }
  return new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the browser made no picture"))), "image/png"));
}
