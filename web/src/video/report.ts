/** What was found as files: a table (CSV) and everything (JSON). */
import type { Camera, Scene } from "gravisight";
import { SAME, type Curve, type FrameDetection } from "./detections";

const COLUMNS = [
  "time_s", "u_px", "v_px", "depth_m", "x_m", "y_m", "z_m", "confidence",
  "fit_x_m", "fit_y_m", "fit_z_m", "fit_sigma_m", "speed_m_s", "outlier", "explained", "video_time_s",
];

export function csvOf(detections: FrameDetection[], fit: Curve | undefined): string {
  const rows = detections.map(({ timeMs, filmed, image, depth, world, confidence }) => {
    const point = fittedAt(fit, filmed);
    const of = point ? [...point.world, point.sigma, point.speed].map(number) : ["", "", "", "", ""];
    const place = world && depth !== null ? [depth, ...world].map(number) : ["", "", "", ""];
    const all = [...[filmed, ...image].map(number), ...place, number(confidence)];
    return [...all, ...of, point ? String(point.outlier) : "", point ? String(point.explained) : "", number(timeMs / 1000)].join(",");
  });
  return `${[COLUMNS.join(","), ...rows].join("\r\n")}\r\n`;
}

export function jsonOf(detections: FrameDetection[], fit: Curve | undefined, about: { source: string; camera: Camera | undefined; scene: Scene | undefined; threshold: number }): string {
  const frames = detections.map(({ timeMs, filmed, ...rest }) => ({ time: filmed, videoTime: timeMs / 1000, ...rest }));
  return JSON.stringify({ ...about, units: "seconds, metres, pixels; world z up", frames, fit: fit ?? null }, null, 1);
}

/** The fit's frame of a time; times that were in seconds and back differ in the last digits. */
export function fittedAt(fit: Curve | undefined, seconds: number): Curve["frames"][number] | undefined {
  const frames = fit?.frames ?? [];
  let low = 0;
  let high = frames.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (1000 * frames[middle]!.time < 1000 * seconds - SAME) low = middle + 1;
    else high = middle;
  }
  const frame = frames[low];
  return frame && 1000 * (frame.time - seconds) < SAME ? frame : undefined;
}

function number(value: number): string {
  return String(Number(value.toPrecision(9)));
}
