/** What the core makes of the points, by the points' own numbers. */
import { GravisightError, type Calibration as CalibrationResult, type CourtLine, type Toolbox } from "gravisight";
import type { Pixel } from "../shared/canvas";
import { tools } from "../shared/core";
import { wholeOf, type State } from "./state";

export interface Calibration {
  found: CalibrationResult;
  /** Where the camera puts each point; null where it cannot see it. */
  put: (Pixel | null)[];
  /** From each click to where the camera puts its point, pixels. */
  residuals: Map<number, Pixel>;
  /** Points whose clicks were left out, as the core counts them. */
  outliers: Map<number, CalibrationResult["outliers"][number]>;
  /** Where the camera puts the court's painted lines: runs of pixels. */
  lines: { run: Pixel[]; isFound: boolean }[];
  /** Why the lines in the picture had no part in it; empty where they had, or there are none. */
  withoutLines: string;
}

/** Places along a line that are drawn; more than two, since a lens bends it. */
const ALONG = 24;

export async function calibrated(state: State, { width, height }: { width: number; height: number }): Promise<Calibration> {
  const usable = state.usable();
  const whole = state.given.points.flatMap((point, index) => {
    const place = wholeOf(point);
    return place ? [{ index, place }] : [];
  });
  const toolbox = await tools();
  const { found, withoutLines } = await byLinesOrClicks(toolbox, state, { width, height });
  const images = await toolbox.project(found.camera, whole.map(({ place }) => place));
  const put: (Pixel | null)[] = [];
  for (const [order, { index }] of whole.entries()) put[index] = images[order] ?? null;
  return {
    found,
    put,
    residuals: new Map(usable.flatMap((index, order) => (found.residualsPx[order] ? [[index, found.residualsPx[order]]] : []))),
    outliers: new Map(found.outliers.map((outlier) => [usable[outlier.index] ?? 0, outlier])),
    lines: await drawnLines(toolbox, state, found),
    withoutLines,
  };
}

/** With the court's painted lines where the picture shows them; else by the clicks alone. */
async function byLinesOrClicks(toolbox: Toolbox, state: State, { width, height }: { width: number; height: number }): Promise<{ found: CalibrationResult; withoutLines: string }> {
  const points = state.asFile(width, height);
  const estimate = state.lens.distortion ? (["distortion"] as const) : [];
  const hasLines = (await linesOf(toolbox, state)).length > 0;
  if (!hasLines || !state.picture) return { found: await toolbox.calibrate(points, { estimate: [...estimate] }), withoutLines: "" };
  try {
    return { found: await toolbox.calibrate(points, { estimate: [...estimate], picture: state.picture }), withoutLines: "" };
  } catch (thrown) {
    if (!(thrown instanceof GravisightError)) throw thrown;
    // Where the clicks are to blame, they say so themselves.
    return { found: await toolbox.calibrate(points, { estimate: [...estimate] }), withoutLines: thrown.message };
  }
}

/** The lines that are looked for. */
async function linesOf(toolbox: Toolbox, { given, placing }: State): Promise<CourtLine[]> {
  return given.court ? (placing?.lines ?? (await toolbox.court(given.court)).lines ?? []) : [];
}

async function drawnLines(toolbox: Toolbox, state: State, { camera, lines: seen }: CalibrationResult): Promise<Calibration["lines"]> {
  const lines = await linesOf(toolbox, state);
  const runs = await Promise.all(lines.map((line) => toolbox.project(camera, placesAlong(line))));
  return runs.map((run, index) => ({ run: run.filter((at) => at !== null), isFound: (seen[index]?.share ?? 0) > 0 }));
}

function placesAlong({ from, to }: CourtLine): [number, number, number][] {
  const at = (fraction: number, axis: 0 | 1 | 2) => from[axis] + fraction * (to[axis] - from[axis]);
  return Array.from({ length: ALONG + 1 }, (_, step) => [at(step / ALONG, 0), at(step / ALONG, 1), at(step / ALONG, 2)]);
}
