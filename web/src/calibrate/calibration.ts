/** What the core makes of the points, by the points' own numbers. */
import type { CalibrationResult } from "gravisight";
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
}

export async function calibrated(state: State, { width, height }: { width: number; height: number }): Promise<Calibration> {
  const usable = state.usable();
  const whole = state.given.points.flatMap((point, index) => {
    const place = wholeOf(point);
    return place ? [{ index, place }] : [];
  });
  const toolbox = await tools();
  const found = await toolbox.calibrate(state.asFile(width, height), { estimate: state.lens.distortion ? ["distortion"] : [] });
  const images = await toolbox.project(found.camera, whole.map(({ place }) => place));
  const put: (Pixel | null)[] = [];
  for (const [order, { index }] of whole.entries()) put[index] = images[order] ?? null;
  return {
    found,
    put,
    residuals: new Map(usable.flatMap((index, order) => (found.residualsPx[order] ? [[index, found.residualsPx[order]]] : []))),
    outliers: new Map(found.outliers.map((outlier) => [usable[outlier.index] ?? 0, outlier])),
  };
}
