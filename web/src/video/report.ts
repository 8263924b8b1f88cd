/** What was found as files: a table (CSV) and everything (JSON). */
import type { Camera, Scene, Trajectory, TrajectoryPoint } from "gravisight";
import type { Seen } from "./sightings";

const COLUMNS = [
  "time_s", "u_px", "v_px", "depth_m", "x_m", "y_m", "z_m", "confidence",
  "fit_x_m", "fit_y_m", "fit_z_m", "fit_sigma_m", "speed_m_s", "outlier",
];

export function csvOf(seen: Seen[], fit: Trajectory | undefined): string {
  const fitted = byTime(fit);
  const rows = seen.map(({ timeMs, image, depth, world, confidence }) => {
    const point = fitted.get(timeMs);
    const of = point ? [...point.world, point.sigma, point.speed].map(number) : ["", "", "", "", ""];
    const all = [timeMs / 1000, ...image, depth, ...world, confidence].map(number);
    return [...all, ...of, point ? String(point.outlier) : ""].join(",");
  });
  return `${[COLUMNS.join(","), ...rows].join("\r\n")}\r\n`;
}

export function jsonOf(seen: Seen[], fit: Trajectory | undefined, about: { source: string; camera: Camera | undefined; scene: Scene; threshold: number }): string {
  const frames = seen.map(({ timeMs, ...rest }) => ({ t: timeMs / 1000, ...rest }));
  return JSON.stringify({ ...about, units: "seconds, metres, pixels; world z up", frames, fit: fit ?? null }, null, 1);
}

/** The fit's points by their frame's time. */
function byTime(fit: Trajectory | undefined): Map<number, TrajectoryPoint> {
  const points = (fit?.points ?? []).map((point): [number, TrajectoryPoint] => [point.timestampMs, point]);
  return new Map(points);
}

function number(value: number): string {
  return String(Number(value.toPrecision(9)));
}
