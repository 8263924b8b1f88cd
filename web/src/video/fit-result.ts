/** What the fit says, in words: flights, hits, where the ball bounced, and what is odd. */
import { make } from "../dom";
import type { Curve } from "./sightings";

const NOT_EXPLAINED = "Do not trust the curve where it is not explained. Often the scene is not the real one (drop a scene.json), or the camera has moved.";

export class FitResult {
  readonly #place: HTMLElement;

  constructor(place: HTMLElement) {
    this.#place = place;
  }

  show({ explained, verdict, notes, rmsPx, frames, impacts, flights, hits }: Curve): void {
    this.#place.dataset.tone = explained ? "good" : "bad";
    const speeds = frames.map(({ speed }) => speed);
    const outliers = frames.filter(({ outlier }) => outlier).length;
    const left = outliers ? ` ${outliers} ${outliers === 1 ? "sighting does" : "sightings do"} not belong to it and had no part.` : "";
    const range = speeds.length ? `, ${Math.min(...speeds).toFixed(1)} to ${Math.max(...speeds).toFixed(1)} m/s` : "";
    const off = rmsPx === undefined ? "" : `the curve misses the sightings by ${rmsPx.toFixed(2)} px (rms).`;
    const explains = rmsPx === undefined ? sentence(verdict) : `Physics explains the track${range}: ${off}`;
    const words = explained ? explains : `${sentence(verdict)} ${NOT_EXPLAINED} ${off && sentence(off)}`.trim();
    const parts: HTMLElement[] = [make("p", { text: words + left, part: "video-fit-words" })];
    for (const note of notes) parts.push(make("p", { text: sentence(note), part: "video-fit-note" }));
    if (hits.length) parts.push(flightsTable(flights), hitsTable(hits));
    else if (flights[0]?.explained) parts.push(make("p", { text: `At first ${speedWords(flights[0])}${spinWords(flights[0])}.`, part: "video-fit-start" }));
    if (impacts.length) parts.push(impactsTable(impacts));
    else parts.push(make("p", { text: "No bounces." }));
    const stale = make("p", { text: "Frames came after this fit: fit again to take them in.", part: "video-fit-stale" });
    stale.hidden = true;
    this.#place.replaceChildren(...parts, stale);
  }

  /** Says whether frames came after the fit. */
  setStale(isStale: boolean): void {
    const words = this.#place.querySelector<HTMLElement>('[data-part="video-fit-stale"]');
    if (words) words.hidden = !isStale;
  }

  clear(): void {
    this.#place.replaceChildren();
  }
}

/** A table with a caption; each row's cells in words. */
function tableOf(part: string, caption: string, head: string[], rows: string[][]): HTMLElement {
  const titles = head.map((text) => {
    const cell = make("th", { text });
    cell.scope = "col";
    return cell;
  });
  const lines = rows.map((texts) => make("tr", { part }, ...texts.map((text) => make("td", { text }))));
  return make("table", { part: `${part}s` }, make("caption", { text: caption }), make("thead", {}, make("tr", {}, ...titles)), make("tbody", {}, ...lines));
}

/** In place of what belongs to a flight that is not explained: it would be a number without a meaning. */
const UNKNOWN = "not known";

const counted = (count: number, what: string, many = `${what}s`) => `${count} ${count === 1 ? what : many}`;
const inSeconds = (time: number) => `${time.toFixed(2)} s`;
const sentence = (words: string) => `${words.charAt(0).toUpperCase()}${words.slice(1)}${/[.?!]$/.test(words) ? "" : "."}`;

function impactsTable(impacts: Curve["impacts"]): HTMLElement {
  const lined = impacts.some(({ withinLines }) => withinLines !== null);
  const rows = impacts.map(({ time, surface, speed, withinLines, explained }) => {
    const row = [inSeconds(time), surfaceWords(surface), explained ? `${speed.toFixed(1)} m/s` : UNKNOWN];
    return lined ? [...row, withinLines === null || !explained ? "" : `${(100 * withinLines).toFixed(0)} %`] : row;
  });
  const heads = ["Time", "On", "Speed", ...(lined ? ["Within the lines"] : [])];
  return tableOf("video-bounce", counted(impacts.length, "bounce"), heads, rows);
}

function hitsTable(hits: Curve["hits"]): HTMLElement {
  const rows = hits.map(({ time, world, explained }) => [inSeconds(time), explained ? world.map((metres) => metres.toFixed(2)).join(", ") : UNKNOWN]);
  return tableOf("video-hit", counted(hits.length, "hit"), ["Time", "At x, y, z (m)"], rows);
}

function flightsTable(flights: Curve["flights"]): HTMLElement {
  const rows = flights.map((flight) => [
    `${inSeconds(flight.start)} to ${inSeconds(flight.end)}`,
    flight.explained ? `${speedWords(flight)}${spinWords(flight)}` : UNKNOWN,
    flight.explained ? "explained" : (flight.reason ?? "not explained"),
  ]);
  return tableOf("video-flight", counted(flights.length, "flight"), ["Flight", "At its start", ""], rows);
}

type Flight = Curve["flights"][number];

function speedWords({ speedStart, speedSigma }: Flight): string {
  const digits = speedSigma < 0.095 ? 2 : 1;
  return `${speedStart.toFixed(digits)} ± ${speedSigma.toFixed(digits)} m/s (${(3.6 * speedStart).toFixed(0)} km/h)`;
}

/** The spin in turns a second, where more is known of it than that there may be one. */
function spinWords({ spin, spinSigma }: Flight): string {
  const turns = (values: number[]) => Math.hypot(...values) / (2 * Math.PI);
  const [size, sigma] = [turns(spin), turns(spinSigma)];
  return size > sigma && sigma > 0 ? `, ${size.toFixed(0)} ± ${sigma.toFixed(0)} turns/s` : "";
}

/** The core counts from nought, people from one. */
function surfaceWords(surface: string): string {
  return surface.replace(/^box(?:es)?\[(\d+)\]$/, (_, index: string) => `box ${Number(index) + 1}`).replace(/^walls?\[(\d+)\]$/, (_, index: string) => `wall ${Number(index) + 1}`);
}
