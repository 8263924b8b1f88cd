/** The court from above: its painted lines, and its points to choose from. */
import type { CourtLine, Vector } from "gravisight";
import { levelOf } from "./court-points";
import type { Standing } from "./list";
import { wholeOf, type Point } from "./state";

type Spot = [x: number, y: number];

/** Units of the drawing: CSS pixels, where there is room for it. */
const WIDTH = 360;
const HEIGHT = 330;
const EDGE = 18;
/** From a point to the one above it in the world. */
const RAISED_BY: Spot = [13, 9];
/** Of a finger. */
const REACH = 26;
const DOT = 6;
/** Dots closer than this hide one another. */
const APART = 13;

interface Dot {
  place: SVGGElement;
  at: Spot;
}

export class CourtMap {
  readonly #svg: SVGSVGElement;
  readonly #choose: (index: number) => void;
  #dots: Dot[] = [];
  /** What is drawn. */
  #drawn = "";

  constructor(place: HTMLElement, choose: (index: number) => void) {
    this.#choose = choose;
    this.#svg = draw("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "court-map", role: "group", "aria-label": "The court from above: choose a point" });
    place.append(this.#svg);
    this.#svg.addEventListener("click", (event) => {
      const nearest = this.#nearest(event);
      if (nearest !== undefined) choose(nearest);
    });
    this.#svg.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Draws a court, unless it is drawn already: a dot may have the focus. */
  fill(points: Point[], lines: CourtLine[]): void {
    const drawn = JSON.stringify([points.map(({ name, world }) => [name, world]), lines]);
    if (drawn === this.#drawn) return;
    this.#drawn = drawn;
    const worlds = points.map((point) => wholeOf(point) ?? [0, 0, 0]) as Vector[];
    const level = levelOf(worlds);
    const ranks = worlds.map((world) => rankOf(world, worlds, level));
    const toMap = mapOf([...worlds, ...lines.flatMap(({ from, to }) => [from, to])], Math.max(0, ...ranks.map(Math.abs)));
    const painted = lines.map(({ from, to }) => line("court-line", toMap(from), toMap(to)));
    const stems: SVGElement[] = [];
    const dots: Dot[] = [];
    for (const [index, world] of worlds.entries()) {
      const rank = ranks[index] ?? 0;
      const foot = toMap(world);
      const raised: Spot = [foot[0] + Math.sign(world[0]) * Math.abs(rank) * RAISED_BY[0], foot[1] - rank * RAISED_BY[1] - (world[0] === 0 ? 4 * rank : 0)];
      const at = apart(raised, dots.map((dot) => dot.at));
      if (at[0] !== foot[0] || at[1] !== foot[1]) stems.push(line("court-stem", foot, at));
      dots.push({ place: this.#dot(at, index, rank !== 0), at });
    }
    this.#dots = dots;
    this.#svg.replaceChildren(...painted, ...stems, ...dots.map(({ place }) => place));
  }

  /** Shows how each point is. */
  update(points: Point[], current: number, standing: (index: number) => Standing): void {
    const hadFocus = this.#dots.findIndex(({ place }) => place === document.activeElement);
    for (const [index, { place }] of this.#dots.entries()) {
      const point = points[index];
      if (!point) continue;
      const { outlier } = standing(index);
      const state = point.click ? (outlier ? "wrong" : "clicked") : point.isAbsent ? "absent" : "open";
      place.dataset.state = state;
      place.classList.toggle("current", index === current);
      place.setAttribute("aria-pressed", String(index === current));
      place.setAttribute("tabindex", index === (hadFocus >= 0 ? hadFocus : current) ? "0" : "-1");
      const name = `${index + 1}. ${point.name}, ${STATES[state]}`;
      place.setAttribute("aria-label", name);
      place.querySelector("title")!.textContent = name;
    }
  }

  #dot(at: Spot, index: number, isRaised: boolean): SVGGElement {
    const [x, y] = at;
    const cross = `M${x - DOT} ${y - DOT}L${x + DOT} ${y + DOT}M${x - DOT} ${y + DOT}L${x + DOT} ${y - DOT}`;
    const diamond = `M${x} ${y - DOT - 1}l${DOT + 1} ${DOT + 1}l${-DOT - 1} ${DOT + 1}l${-DOT - 1} ${-DOT - 1}z`;
    const shape = isRaised ? draw("path", { class: "court-dot", d: diamond }) : draw("circle", { class: "court-dot", cx: x, cy: y, r: DOT });
    const halo = draw("circle", { class: "court-halo", cx: x, cy: y, r: DOT + 5 });
    const place = draw("g", { class: "court-point", role: "button", "data-part": `cal-map-${index}` }, draw("title"), halo, shape, draw("path", { class: "court-cross", d: cross }));
    if (isRaised) place.dataset.raised = "";
    return place;
  }

  /** The point that a click means: dots are smaller than a finger. */
  #nearest(event: MouseEvent): number | undefined {
    const hit = this.#dots.findIndex(({ place }) => place.contains(event.target as Node));
    // Of a key or a screen reader.
    if (event.detail === 0 && hit >= 0) return hit;
    const box = this.#svg.getBoundingClientRect();
    const at: Spot = [((event.clientX - box.left) / box.width) * WIDTH, ((event.clientY - box.top) / box.height) * HEIGHT];
    const near = this.#dots.map((dot, index) => ({ index, far: Math.hypot(dot.at[0] - at[0], dot.at[1] - at[1]) })).sort((a, b) => a.far - b.far)[0];
    return near && near.far <= REACH ? near.index : undefined;
  }

  #key(event: KeyboardEvent): void {
    const from = this.#dots.findIndex(({ place }) => place === event.target);
    if (from < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter" || event.key === " ") this.#choose(from);
    else {
      const to = this.#next(from, event.key);
      if (to === undefined) return;
      this.#dots[from]?.place.setAttribute("tabindex", "-1");
      this.#dots[to]?.place.setAttribute("tabindex", "0");
      this.#dots[to]?.place.focus();
    }
    event.preventDefault();
  }

  /** The next dot that way; Home and End lead to the first and the last. */
  #next(from: number, key: string): number | undefined {
    if (key === "Home") return 0;
    if (key === "End") return this.#dots.length - 1;
    const way = ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] } as Record<string, Spot>)[key];
    const start = this.#dots[from]?.at;
    if (!way || !start) return undefined;
    const ahead = this.#dots.flatMap(({ at }, index) => {
      const [dx, dy] = [at[0] - start[0], at[1] - start[1]];
      const along = dx * way[0] + dy * way[1];
      const beside = Math.abs(dx * way[1]) + Math.abs(dy * way[0]);
      return along > 1 && beside <= 2 * along ? [{ index, cost: along + 2 * beside }] : [];
    });
    return ahead.sort((a, b) => a.cost - b.cost)[0]?.index;
  }
}

const STATES = { clicked: "clicked", wrong: "perhaps a wrong click", absent: "not in the picture", open: "not clicked" } as const;

/** How many points lie between the lines' level and this one, itself counted; negative below. */
function rankOf([x, y, z]: Vector, all: Vector[], level: number): number {
  if (z === level) return 0;
  const isBetween = (height: number) => (z > level ? height > level && height <= z : height < level && height >= z);
  const heights = new Set(all.filter((other) => other[0] === x && other[1] === y && isBetween(other[2])).map((other) => other[2]));
  return z > level ? heights.size : -heights.size;
}

/** Beside the dots that are there: nearer to the middle of the court. */
function apart([x, y]: Spot, others: Spot[]): Spot {
  const inwards = y > HEIGHT / 2 ? -1 : 1;
  const isFree = (there: number) => others.every((other) => Math.hypot(other[0] - x, other[1] - there) >= APART);
  let there = y;
  while (!isFree(there) && there > 0 && there < HEIGHT) there += inwards;
  return [x, there];
}

/** A plan that fills the drawing: across and along have scales of their own. The far end is at the top. */
function mapOf(places: Vector[], mostRaised: number): (place: Vector) => Spot {
  const span = (axis: 0 | 1) => {
    const values = places.map((place) => place[axis]);
    return [Math.min(...values), Math.max(...values)] as const;
  };
  const [left, right] = span(0);
  const [near, far] = span(1);
  const [aside, above] = [EDGE + mostRaised * RAISED_BY[0], EDGE + mostRaised * RAISED_BY[1]];
  return ([x, y]) => [
    aside + ((x - left) / (right - left || 1)) * (WIDTH - 2 * aside),
    above + ((far - y) / (far - near || 1)) * (HEIGHT - 2 * above),
  ];
}

function line(kind: string, from: Spot, to: Spot): SVGLineElement {
  return draw("line", { class: kind, x1: from[0], y1: from[1], x2: to[0], y2: to[1] });
}

function draw<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Record<string, string | number> = {}, ...children: Node[]): SVGElementTagNameMap[K] {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  made.append(...children);
  return made;
}
