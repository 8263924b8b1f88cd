/** The table of scores on the clip held out, before and now. A score that does not exist is a dash, and the reason is given below. */
import type { TuneScore } from "gravisight";
import { make } from "../dom";
import type { Run } from "./run";

const signed = new Intl.NumberFormat("en", { maximumFractionDigits: 0, signDisplay: "exceptZero" });
const NONE = "–";

interface Row {
  name: string;
  before: number | null | undefined;
  now: number | null | undefined;
  text: (value: number) => string;
  /** How the change is given; default: in per cent. */
  change?: (before: number, now: number) => string;
  /** Why a value is missing, in words. */
  missing: string;
}

function rowsOf({ first, last, found, followed }: Run): Row[] {
  const both = (of: (score: TuneScore) => number | null | undefined) => ({ before: of(first), now: of(last) });
  const pixels = (value: number) => `${value.toFixed(2)} px`;
  const counted = (name: string, counts: Run["found"]): Row => ({
    name: `${name} (of ${counts?.of ?? 0} labelled)`,
    before: counts?.before,
    now: counts?.now,
    text: String,
    change: (before, now) => signed.format(now - before),
    missing: "Found frames are counted when the run is done.",
  });
  return [
    counted("Frames where the ball was found, each frame on its own", found),
    ...(followed ? [counted("Frames where the ball was found, by the video tracker", followed)] : []),
    {
      name: "Forecast 15 frames away, median",
      ...both(({ forecastPx }) => forecastPx),
      text: pixels,
      missing: "No forecast error: the held-out clip is shorter than 31 frames, or half of its forecasts fail. A forecast fails if the model’s positions fit no trajectory.",
    },
    { name: "2D error, median", ...both(({ imageErrorPx }) => imageErrorPx.median), text: pixels, missing: "No 2D error: no labelled frame could be scored." },
    {
      name: "Distance to the truth, mean (where it is known)",
      ...both(({ dtg }) => dtg.mean),
      text: (value) => `${(100 * value).toFixed(1)} cm`,
      missing: "No distance to the truth: the truth is known only for simulated clips.",
    },
  ];
}

/** Fills the table's body, and the note below it. */
export function showScores(body: HTMLElement, note: HTMLElement, run: Run): void {
  const rows = rowsOf(run);
  body.replaceChildren(
    ...rows.map(({ name, before, now, text, change = percent }) => {
      const header = make("th", { text: name });
      header.scope = "row";
      const cell = (value: number | null | undefined) => (isKnown(value) ? text(value) : NONE);
      const changed = isKnown(before) && isKnown(now) ? change(before, now) : NONE;
      return make("tr", {}, header, ...[cell(before), cell(now), changed].map((each) => make("td", { text: each })));
    }),
  );
  const missing = rows.flatMap(({ before, now, missing }) => (isKnown(before) && isKnown(now) ? [] : [missing]));
  note.textContent = [...new Set(missing)].join(" ");
}

/** A number that can be shown. */
export function isKnown(value: number | null | undefined): value is number {
  return typeof value === "number" && Number.isFinite(value);
}

function percent(before: number, now: number): string {
  return before > 0 ? `${signed.format(100 * (now / before - 1))} %` : NONE;
}
