// Following a ball through a video in Node's wasm engine, decoding not counted. After `scripts/build-wasm cpu-relaxed` and `cpu-threads`:
// node benches/peers/tracking.mjs VIDEO WIDTH HEIGHT FPS [THREADS]
import { execFileSync } from "node:child_process";
import { VideoTracker } from "../../pkg/dist/index.js";

const [video, width, height, fps, threads = 1] = process.argv.slice(2).map((value, index) => (index ? Number(value) : value));
// Frames of the beginning are not timed: of them the background is made.
const [first, most] = [32, 200];
const size = 4 * width * height;
const decoded = ["-v", "error", "-i", video, "-frames:v", String(most), "-f", "rawvideo", "-pix_fmt", "rgba", "-"];
const pixels = execFileSync("ffmpeg", decoded, { maxBuffer: 2 ** 32 });
const tracker = await VideoTracker.create({ threads });
const times = [];
for (let frame = 0; (frame + 1) * size <= pixels.length; frame += 1) {
  const data = new Uint8ClampedArray(pixels.subarray(frame * size, (frame + 1) * size));
  const start = performance.now();
  await tracker.add({ data, width, height }, (1000 * frame) / fps);
  times.push(performance.now() - start);
}
const timed = times.slice(first).sort((a, b) => a - b);
const mean = timed.reduce((sum, time) => sum + time, 0) / timed.length;
console.log(`${mean.toFixed(1)} ms a frame (${(1000 / mean).toFixed(0)} a second), median ${timed[timed.length >> 1].toFixed(1)}`);
tracker.dispose();
