/** A line chart: uPlot in the page's colours, with words for who does not see it. */
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { contextOf, make } from "../dom";
import { blobOf } from "./canvas";

type Value = [x: number, y: number];

export interface Series {
  /** What the legend calls it; a single line may go without. */
  name: string;
  /** The CSS variable of its colour. */
  colour: string;
  line?: Value[];
  dots?: Value[];
  /** Dots that are not to be trusted. */
  faint?: Value[];
}

/** A chart's series and the label of its x stay what they are; values, marks, range and the label of y change. */
export interface Content {
  /** Upwards and to the right, with their units. */
  y: string;
  x: string;
  series: Series[];
  /** Places on x to mark. */
  marks?: number[];
  from: number;
  to: number;
}

/** More than these cannot be distinguished. */
const MOST_DOTS = 1200;
const FONT = "12px system-ui, sans-serif";
/** Of a saved picture's charts, whatever the screen is; pixels. */
const SAVED = { width: 960, height: 360 };
const PADDING = 16;

export class Chart {
  readonly #place: HTMLElement;
  readonly #box: HTMLElement;
  /** Hears where on x a click is. */
  onPick: (x: number) => void = () => {};
  readonly #now = make("div", { class: "chart-now" });
  #content: Content | undefined;
  #plot: uPlot | undefined;
  #nowAt: number | undefined;

  constructor(place: HTMLElement, name: string) {
    this.#place = place;
    this.#box = make("div", { part: name });
    this.#now.hidden = true;
    place.classList.add("chart");
    place.append(this.#box, this.#now);
    this.#box.addEventListener("click", (event) => {
      const plot = this.#plot;
      if (plot) this.onPick(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    });
    new ResizeObserver(() => this.#fit()).observe(place);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#plot?.redraw());
  }

  show(content: Content): void {
    this.#content = content;
    this.#box.setAttribute("role", "img");
    this.#box.setAttribute("aria-label", described(content));
    const upwards = this.#plot?.axes[1];
    if (upwards) upwards.label = content.y;
    if (this.#plot) this.#plot.setData(dataOf(content));
    else this.#fit();
    this.#placeNow();
  }

  /** Marks a place on x. */
  showNow(x: number): void {
    this.#nowAt = x;
    this.#placeNow();
  }

  #placeNow(): void {
    const plot = this.#plot;
    const { from = 0, to = 0 } = this.#content ?? {};
    const isShown = plot !== undefined && this.#nowAt !== undefined && this.#nowAt >= from && this.#nowAt <= to;
    this.#now.hidden = !isShown;
    if (!isShown) return;
    const { offsetLeft, offsetTop, clientHeight } = plot.over;
    this.#now.style.setProperty("--x", `${offsetLeft + plot.valToPos(this.#nowAt ?? 0, "x")}px`);
    this.#now.style.setProperty("--y", `${this.#box.offsetTop + offsetTop}px`);
    this.#now.style.setProperty("--height", `${clientHeight}px`);
  }

  /** The chart as it would be at another size. */
  drawn(size: { width: number; height: number }): Promise<HTMLCanvasElement> {
    return new Promise((resolve) => {
      const options = this.#options(size);
      new uPlot({ ...options, hooks: { ...options.hooks, ready: [({ ctx }) => resolve(ctx.canvas)] } }, this.#content && dataOf(this.#content));
    });
  }

  colour(name: string): string {
    return getComputedStyle(this.#box).getPropertyValue(name).trim();
  }

  #fit(): void {
    const width = this.#place.clientWidth;
    // A hidden step has no size; the observer comes back when it is shown.
    if (!width || !this.#content) return;
    const size = { width, height: Math.round(Math.min(300, Math.max(190, width * 0.42))) };
    if (this.#plot) this.#plot.setSize(size);
    else this.#plot = new uPlot(this.#options(size), dataOf(this.#content), this.#box);
    this.#placeNow();
  }

  #options(size: { width: number; height: number }): uPlot.Options {
    const { x, y, series } = this.#content ?? { x: "", y: "", series: [] };
    const axis = (label: string, extra: uPlot.Axis): uPlot.Axis => {
      const line = { stroke: () => this.colour("--line"), width: 1 };
      // As the page writes numbers, not as the browser's language does.
      const values = (_: uPlot, ticks: number[]) => ticks.map((tick) => `${Number(tick.toPrecision(6))}`);
      return { label, values, font: FONT, labelFont: FONT, labelSize: 18, stroke: () => this.colour("--quiet"), grid: line, ticks: { ...line, size: 4 }, gap: 4, ...extra };
    };
    return {
      ...size,
      padding: [series.some(({ name }) => name) ? 26 : 10, 14, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: () => [this.#content?.from ?? 0, this.#content?.to ?? 1] },
        y: { range: (_, low, high) => (low === null || high === null ? [0, 1] : uPlot.rangeNum(low, high, 0.1, true)) },
      },
      axes: [axis(x, { size: 24 }), axis(y, { size: 40 })],
      series: [{}, ...series.flatMap(({ colour }) => lineAndDots(() => this.colour(colour)))],
      hooks: { draw: [(plot) => this.#mark(plot), (plot) => this.#name(plot)] },
    };
  }

  #mark({ ctx, bbox, valToPos }: uPlot): void {
    // uPlot remembers what it set last, and would draw its grid like this.
    ctx.save();
    ctx.strokeStyle = this.colour("--busy");
    ctx.lineWidth = 1.5 * uPlot.pxRatio;
    ctx.setLineDash([4 * uPlot.pxRatio, 3 * uPlot.pxRatio]);
    for (const mark of this.#content?.marks ?? []) {
      const at = valToPos(mark, "x", true);
      ctx.stroke(new Path2D(`M${at} ${bbox.top}v${bbox.height}`));
    }
    ctx.restore();
  }

  /** The legend: on the canvas, so that saved pictures have it. */
  #name({ ctx, bbox }: uPlot): void {
    const scale = uPlot.pxRatio;
    let left = bbox.left / scale;
    ctx.save();
    ctx.scale(scale, scale);
    ctx.font = FONT;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    for (const { name, colour } of this.#content?.series ?? []) {
      if (!name) continue;
      ctx.fillStyle = this.colour(colour);
      ctx.fillRect(left, 10, 14, 3);
      ctx.fillStyle = this.colour("--ink");
      ctx.fillText(name, left + 19, 12);
      left += 19 + ctx.measureText(name).width + 16;
    }
    ctx.restore();
  }
}

function lineAndDots(stroke: () => string): uPlot.Series[] {
  const dots = (size: number): uPlot.Series => ({ stroke, paths: () => null, points: { show: true, size, width: 0, fill: stroke } });
  return [{ stroke, width: 2, spanGaps: true, points: { show: false } }, dots(4.5), { ...dots(3), alpha: 0.35 }];
}

function dataOf({ series }: Content): uPlot.AlignedData {
  const thinned = (dots: Value[]) => dots.filter((_, index) => index % Math.ceil(dots.length / MOST_DOTS) === 0);
  const tables = series.flatMap(({ line = [], dots = [], faint = [] }) => [line, thinned(dots), thinned(faint)]);
  return uPlot.join(tables.map((values) => [values.map(([x]) => x), values.map(([, y]) => y)]));
}

function described({ x, y, series, marks = [], from, to }: Content): string {
  const shown = series.flatMap(({ name, line = [], dots = [], faint = [] }) => {
    const values = [...faint, ...dots, ...line].map(([, value]) => value);
    const [least, most, last] = [Math.min(...values), Math.max(...values), values.at(-1)].map((value) => value?.toFixed(2));
    return values.length ? [`${name} from ${least} to ${most}, last ${last}`.trim()] : [];
  });
  if (shown.length === 0) return `${y}: nothing yet`;
  const bounces = marks.length ? `; marked at ${marks.map((mark) => mark.toFixed(2)).join(", ")}` : "";
  return `${y} over ${x} ${from.toFixed(1)} to ${to.toFixed(1)}: ${shown.join("; ")}${bounces}`;
}

/** The charts, one below the other, as a PNG. */
export async function pictureOf(charts: [Chart, ...Chart[]]): Promise<Blob> {
  const canvas = make("canvas");
  const pictures = await Promise.all(charts.map((chart) => chart.drawn(SAVED)));
  const scale = uPlot.pxRatio;
  canvas.width = scale * (SAVED.width + 2 * PADDING);
  canvas.height = scale * (pictures.length * (SAVED.height + PADDING) + PADDING);
  const context = contextOf(canvas);
  context.fillStyle = charts[0].colour("--card");
  context.fillRect(0, 0, canvas.width, canvas.height);
  for (const [index, picture] of pictures.entries()) context.drawImage(picture, scale * PADDING, scale * (PADDING + index * (SAVED.height + PADDING)));
  return blobOf(canvas, "image/png");
}
