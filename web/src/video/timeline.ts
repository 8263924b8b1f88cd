/** Bounces and hits on the video's time: marks on the slider, and ways there from rows, plots and keys. */
import type { Findings } from "gravisight";
import { make } from "../dom";
import { arrow } from "../shared/picture-view";
import type { Source } from "./sources";
import type { TrackResult } from "./track-result";

/** Frames that Shift with an arrow key passes over. */
const STRIDE = 10;
/** Whose keys are their own. */
const OWN_KEYS = "input:not([type=checkbox], [type=radio], [type=range]), select, textarea, summary, [data-part=video-view]";

/** Draws a mark for each bounce and hit above the slider. */
export function markContacts(place: HTMLElement, { contacts }: Findings, shownMs: (seconds: number) => number, durationMs: number): void {
  const marks = contacts.map(({ time, bounce, what }) => {
    const mark = make("span", { class: bounce === null ? "mark-hit" : "mark-bounce", part: "video-mark" });
    mark.title = `${bounce === null ? what : what.replace(" ", ` ${bounce} `)}, ${time.toFixed(2)} s`;
    mark.dataset.time = String(time);
    mark.style.setProperty("--at", String(durationMs > 0 ? shownMs(time) / durationMs : 0));
    return mark;
  });
  place.replaceChildren(...marks);
}

/** Goes where a click on something with `data-time` (seconds of filming) leads. */
export function listenForTimes(places: HTMLElement[], goTo: (seconds: number) => void): void {
  for (const place of places) {
    place.addEventListener("click", (event) => {
      const target = (event.target as Element).closest<HTMLElement | SVGElement>("[data-time]");
      if (target) goTo(Number(target.dataset.time));
    });
  }
}

/** Keys wherever the focus is in the step: arrows step, Space plays and stops, Home and End go to the ends. True if the key was of use. */
export function playerKey(event: KeyboardEvent, panel: HTMLElement, source: Source, togglePlay: () => void, result: TrackResult | undefined): boolean {
  const target = event.target as HTMLElement;
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  if (target !== document.body && !panel.contains(target)) return false;
  if (target.matches(OWN_KEYS)) return false;
  const direction = arrow(event.key);
  if (direction && direction[0] !== 0 && !target.matches("[type=radio]")) {
    stepBy(source, direction[0] * (event.shiftKey ? STRIDE : 1), result);
    return true;
  }
  if (event.key === " " && !target.matches("button, a, input")) {
    togglePlay();
    return true;
  }
  return false;
}

function stepBy(source: Source, frames: number, result: TrackResult | undefined): void {
  const times = result?.record.timesMs;
  const current = source.current?.timeMs ?? 0;
  if (Math.abs(frames) === 1 || !times || !result) return source.step(frames > 0 ? 1 : -1);
  source.pause();
  const to = Math.min(Math.max(result.frameAt(current) + frames, 0), times.length - 1);
  source.seek(times[to] ?? current);
}
