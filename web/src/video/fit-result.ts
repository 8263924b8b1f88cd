/** The result for people: the verdict, why something is not explained, flights and bounces, the place from above. */
import type { Findings, Measured } from "gravisight";
import { make } from "../dom";
import { planOf } from "./plan";
import { inUnit, type Units } from "./units";
import type { Curve } from "./detections";

/** Which numbers are bold; the core decides, see `Findings` of the package. */
const RULE = "Bold: positions known to within 0.3 m and a tenth of their distance from the camera; speeds and spins known to within a tenth. Grey: known less well. ± is 1 σ.";
const NOT_EXPLAINED = "Often the scene does not match the real one, the camera has moved, or something else was tracked: check the ring in the video, and click the ball in frames where the ring is not on it.";
const METRES = "This is the ball in pixels. For metres, speeds and bounces: calibrate the camera on a frame (four clicks on a court) or drop its camera.json, choose the place and ball, and track again.";

export class FitResult {
  readonly #verdict: HTMLElement;
  readonly #place: HTMLElement;
  units: Units;

  /** The verdict has a place of its own, above everything. */
  constructor(verdict: HTMLElement, place: HTMLElement, units: Units) {
    this.units = units;
    this.#verdict = verdict;
    this.#place = place;
  }

  /** In {@link FitResult.units}. */
  show({ findings, explained, flat, frames, flights }: Curve): void {
    this.#verdict.hidden = false;
    this.#verdict.dataset.tone = flat ? "plain" : explained ? "good" : "bad";
    this.#verdict.replaceChildren(make("p", { text: findings.headline, part: "video-fit-words" }));
    const left = make("div", { class: "video-told" }, ...this.#remarks(findings, flat, frames.filter(({ outlier }) => outlier).length), ...tables(findings, flights.map(({ start }) => start), this.units));
    const plan = findings.plan?.bounces.length ? [figure(findings.plan, new Map(findings.contacts.flatMap(({ bounce, time }) => (bounce === null ? [] : [[bounce, time]]))))] : [];
    const stale = make("p", { text: "New frames were added after this fit: fit again to include them.", part: "video-fit-stale" });
    stale.hidden = true;
    this.#place.hidden = left.childElementCount + plan.length === 0;
    this.#place.replaceChildren(make("div", { class: "video-findings" }, left, ...plan), stale);
  }

  /** What is not explained, folded; and what else is to be known. */
  #remarks({ reasons, notes, contacts }: Findings, flat: boolean, outliers: number): HTMLElement[] {
    const parts: HTMLElement[] = [];
    if (flat) parts.push(make("p", { text: METRES, part: "video-flat" }));
    if (reasons.length) {
      const list = make("dl", { class: "video-reasons" }, ...reasons.flatMap(({ what, why }) => [make("dt", { text: what }), make("dd", { text: why })]));
      const unknown = contacts.filter(({ place }) => !place).map(({ what, time }) => `${what} at ${inSeconds(time)}`);
      const also = unknown.length ? [make("p", { text: `Doubtful, position unknown: ${unknown.join(", ")}.` })] : [];
      parts.push(make("details", { part: "video-reasons" }, make("summary", { text: "What is not explained, and why" }), list, ...also, make("p", { text: NOT_EXPLAINED })));
    }
    const outlierNote = outliers ? [`${outliers} ${outliers === 1 ? "detection does" : "detections do"} not fit the trajectory and had no influence.`] : [];
    for (const text of [...notes, ...outlierNote]) parts.push(make("p", { text, part: "video-fit-note" }));
    return parts;
  }

  /** Shows whether frames came after the fit. */
  setStale(isStale: boolean): void {
    const note = this.#place.querySelector<HTMLElement>('[data-part="video-fit-stale"]');
    if (note) note.hidden = !isStale;
  }

  clear(): void {
    for (const place of [this.#verdict, this.#place]) {
      place.hidden = true;
      place.replaceChildren();
    }
  }
}

/** Flights, bounces and hits of which something is known. */
function tables({ flights, contacts }: Findings, starts: number[], units: Units): HTMLElement[] {
  const spinning = flights.some(({ spin }) => spin);
  const known = flights.flatMap(({ when, speed, spin, explained }, index) =>
    explained ? [{ part: "video-flight", cells: [String(index + 1), moment(when, starts[index] ?? 0), measured(speed, units.speed), ...(spinning ? [spin ? measured(spin, units.spin) : ""] : [])] }] : [],
  );
  const placed = contacts.filter(({ place }) => place);
  const lined = placed.some(({ withinLines }) => withinLines !== null);
  const rows = placed.map(({ what, bounce, time, place, speed, withinLines }) => ({
    part: bounce === null ? "video-hit" : "video-bounce",
    cells: [
      bounce === null ? what : what.replace(" ", ` ${bounce} `),
      moment(inSeconds(time), time),
      measured(place, units.length),
      speed === null ? "" : `${(units.speed.per * speed).toFixed(1)}\u00a0${units.speed.name}`,
      ...(lined ? [withinLines === null ? "" : `${(100 * withinLines).toFixed(0)}\u00a0%`] : []),
    ],
  }));
  const made: HTMLElement[] = [];
  if (known.length) made.push(tableOf("video-flights", "Flights", ["", "When", "Initial speed", ...(spinning ? ["Spin"] : [])], known));
  if (rows.length) made.push(tableOf("video-contacts", "Bounces and hits", ["What", "Time", "Where", "Impact speed", ...(lined ? ["Within the lines"] : [])], rows));
  if (made.length) made.push(make("p", { class: "quiet", text: RULE, part: "video-rule" }));
  return made;
}

function figure(plan: NonNullable<Findings["plan"]>, times: Map<number, number>): HTMLElement {
  const caption = "Top view, bounces by number (x to the right, y up). The ellipse contains the bounce with a probability of 86 % (2 σ).";
  return make("figure", { class: "video-plan", part: "video-plan" }, planOf(plan, times), make("figcaption", { class: "quiet", text: caption }));
}

type Cell = string | HTMLElement;

/** A table with a caption, in a box of its own: it scrolls there and not with the page. */
function tableOf(part: string, caption: string, head: string[], rows: { part: string; cells: Cell[] }[]): HTMLElement {
  const titles = head.map((text) => {
    const cell = make(text ? "th" : "td", { text });
    if (cell instanceof HTMLTableCellElement && text) cell.scope = "col";
    return cell;
  });
  const lines = rows.map(({ part, cells }) => make("tr", { part }, ...cells.map((cell) => (typeof cell === "string" ? make("td", { text: cell }) : make("td", {}, cell)))));
  const table = make("table", { part }, make("caption", { text: caption }), make("thead", {}, make("tr", {}, ...titles)), make("tbody", {}, ...lines));
  const box = make("div", { class: "video-table" }, table);
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", caption);
  return box;
}

/** A moment that the video can be sent to. */
function moment(text: string, seconds: number): HTMLElement {
  const button = make("button", { class: "text-button", text, part: "video-moment" });
  button.type = "button";
  button.dataset.time = String(seconds);
  button.title = "Show this moment in the video";
  return button;
}

/** A number with its uncertainty: bold where it may be read as a fact. */
function measured(number: Measured | null, unit: Units["speed"]): HTMLElement {
  if (!number) return make("span", { class: "vague", text: "not known" });
  const { value, sigma, precise } = inUnit(number, unit);
  return make("span", { class: precise ? "precise" : "vague" }, make(precise ? "strong" : "span", { text: unbroken(value) }), make("small", { text: ` ± ${sigma}` }));
}

/** A number stays in a line with its unit, a coordinate with its axis. */
const unbroken = (value: string) => value.replace(/([xyz]) /g, "$1\u00a0").replace(/ (m|m\/s|rev\/s|km\/h|mph|ft|rpm)\b/g, "\u00a0$1");
const inSeconds = (time: number) => `${time.toFixed(2)}\u00a0s`;
