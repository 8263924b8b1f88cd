/** Courts that are drawn: exact paint on plain ground, seen by a camera that is known. */
import { execFileSync } from "node:child_process";

const GROUND = [70, 105, 120];
const PAINT = [228, 230, 225];
/** Rays a pixel, along each side. */
const RAYS = 2;

/** Behind the near end of a tennis court, a little aside. */
export const seatedCamera = cameraAt([3, -29, 9], [0.5, -1, 0], { width: 960, height: 540, focal: 1400 });

/** A camera at `place` that looks at `target`, m. */
export function cameraAt(place, target, { width, height, focal }) {
  const forward = unit(place.map((value, axis) => target[axis] - value));
  const right = unit([forward[1], -forward[0], 0]);
  const down = cross(forward, right);
  const row = (axis) => [...axis, -dot(axis, place)];
  const intrinsic = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]];
  return { width, height, intrinsic, camera_from_world: [row(right), row(down), row(forward), [0, 0, 0, 1]] };
}

/** The pixels of `lines` on the ground, with a little noise. */
export function drawnCourt(lines, camera = seatedCamera) {
  const { width, height, intrinsic, camera_from_world: pose } = camera;
  const [[focal, , x], [, , y]] = intrinsic;
  const place = [0, 1, 2].map((axis) => -pose.slice(0, 3).reduce((sum, row) => sum + row[axis] * row[3], 0));
  const strips = lines.map(({ from, to, width, paint }) => {
    const along = unit([to[0] - from[0], to[1] - from[1], 0]);
    const aside = paint ?? [-along[1], along[0], 0];
    return { from, along, aside, length: Math.hypot(to[0] - from[0], to[1] - from[1]), least: paint ? 0 : -width / 2, most: paint ? width : width / 2 };
  });
  const isPainted = ([u, v]) => {
    const seen = [(u - x) / focal, (v - y) / focal, 1];
    const ray = [0, 1, 2].map((axis) => pose.slice(0, 3).reduce((sum, row, index) => sum + row[axis] * seen[index], 0));
    if (ray[2] >= 0) return false;
    const far = -place[2] / ray[2];
    const on = [place[0] + far * ray[0], place[1] + far * ray[1], 0];
    return strips.some(({ from, along, aside, length, least, most }) => {
      const off = [on[0] - from[0], on[1] - from[1], 0];
      const [lengthwise, across] = [dot(off, along), dot(off, aside)];
      return lengthwise >= 0 && lengthwise <= length && across >= least && across <= most;
    });
  };
  const data = new Uint8ClampedArray(width * height * 4);
  let seed = 1;
  for (let at = 0; at < width * height; at++) {
    const [column, row] = [at % width, Math.floor(at / width)];
    let share = 0;
    for (let ray = 0; ray < RAYS * RAYS; ray++) {
      const [aside, below] = [ray % RAYS, Math.floor(ray / RAYS)].map((index) => (index + 0.5) / RAYS - 0.5);
      share += isPainted([column + aside, row + below]) / (RAYS * RAYS);
    }
    seed = (seed * 48271) % 2147483647;
    const noise = (seed % 7) - 3;
    data.set([...GROUND.map((level, channel) => level + share * (PAINT[channel] - level) + noise), 255], 4 * at);
  }
  return { data, width, height };
}

/** Pixels as a PNG. */
export function pngOf({ data, width, height }) {
  return encoded({ data, width, height }, ["-f", "image2pipe", "-c:v", "png", "-"]);
}

/** A second of a video that shows them. */
export function stillVideoOf(picture, file) {
  encoded(picture, ["-vf", "loop=24:1:0", "-r", "25", "-c:v", "libvpx-vp9", "-crf", "10", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "8", "-pix_fmt", "yuv420p", "-y", file]);
}

function encoded({ data, width, height }, output) {
  const input = ["-v", "error", "-f", "rawvideo", "-pix_fmt", "rgba", "-s", `${width}x${height}`, "-i", "-"];
  return execFileSync("ffmpeg", [...input, ...output], { input: data, maxBuffer: 2 ** 26 });
}

function unit(vector) {
  const length = Math.hypot(...vector);
  return vector.map((value) => value / length);
}

function dot(a, b) {
  return a.reduce((sum, value, axis) => sum + value * b[axis], 0);
}

function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}
