/** What the fit says, in words, and where the ball bounced. */
import type { Trajectory } from "gravisight";
import { make } from "../dom";

const NOT_EXPLAINED =
  "Gravity, drag and the scene’s surfaces do not explain this track: do not trust the curve. Often the scene is not the real one (drop a scene.json), the camera has moved, or more than one throw is in it.";

export class FitResult {
  readonly #place: HTMLElement;

  constructor(place: HTMLElement) {
    this.#place = place;
  }

  show({ explained, rmsPx, points, bounces }: Trajectory): void {
    this.#place.dataset.tone = explained ? "good" : "bad";
    const speeds = points.map(({ speed }) => speed);
    const outliers = points.filter(({ outlier }) => outlier).length;
    const left = outliers ? ` ${outliers} ${outliers === 1 ? "sighting does" : "sightings do"} not belong to it and had no part.` : "";
    const range = speeds.length ? `, ${Math.min(...speeds).toFixed(1)} to ${Math.max(...speeds).toFixed(1)} m/s` : "";
    const words = explained ? `Physics explains the track${range}: the curve misses the sightings by ${rmsPx.toFixed(2)} px (rms).` : `${NOT_EXPLAINED} It misses the sightings by ${rmsPx.toFixed(2)} px (rms).`;
    const parts: HTMLElement[] = [make("p", { text: words + left, part: "video-fit-words" })];
    if (bounces.length) parts.push(tableOf(bounces));
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

function tableOf(bounces: Trajectory["bounces"]): HTMLElement {
  const table = make("table", { part: "video-bounces" }, make("caption", { text: bounces.length === 1 ? "1 bounce" : `${bounces.length} bounces` }));
  const head = make("tr");
  for (const text of ["Time", "On", "Speed"]) {
    const cell = make("th", { text });
    cell.scope = "col";
    head.append(cell);
  }
  table.append(make("thead", {}, head));
  const rows = bounces.map(({ timestampMs, surface, speed }) => {
    const texts = [`${(timestampMs / 1000).toFixed(2)} s`, surfaceWords(surface), `${speed.toFixed(1)} m/s`];
    return make("tr", { part: "video-bounce" }, ...texts.map((text) => make("td", { text })));
  });
  table.append(make("tbody", {}, ...rows));
  return table;
}

/** The core counts from nought, people from one. */
function surfaceWords(surface: string): string {
  return surface.replace(/^box(?:es)?\[(\d+)\]$/, (_, index: string) => `box ${Number(index) + 1}`).replace(/^walls?\[(\d+)\]$/, (_, index: string) => `wall ${Number(index) + 1}`);
}
