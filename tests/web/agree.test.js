/** The same clip gives the same flights and the same verdict in the command, the package and the page. A real clip. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { VideoTracker } from "gravisight";
import { launch, open, saved } from "./support/browser.js";
import { gravisight } from "./support/command.js";
import { real } from "./support/demo.js";
import { serve } from "./support/server.js";

/** Tracking takes so long at most, on a busy machine. */
const PATIENCE = { timeout: 240_000 };
const clip = fileURLToPath(new URL("../../web/public/real/toss_wall.mp4", import.meta.url));
/** Of the clip. */
const [WIDTH, HEIGHT, FPS] = [1920, 1080, 30];
/**
 * Of the same pixels all find the same; a browser's decoder rounds colours in its own way, and a crop that lies a pixel beside is seen a little
 * differently. At most and in the middle, px; the ball's radius is 35.
 */
const [PIXELS, USUAL] = [7, 1.75];
/** Of a speed, as a fraction. */
const SPEEDS = 0.02;

/** What all of them tell, in one form. */
const told = (headline, frames, flights) => ({ headline, frames, flights: flights.map(({ explained, speedStart, speed_start = speedStart }) => ({ explained, speed: speed_start })) });

function byCommand() {
  const camera = join(mkdtempSync(join(tmpdir(), "gravisight-agree-")), "camera.json");
  writeFileSync(camera, JSON.stringify(real.camera));
  let text;
  try {
    text = gravisight(["track", clip, "--scene", "free", "--camera", camera, "--ball", String(real.ball.radius), "--json"], { maxBuffer: 2 ** 26 });
  } catch (thrown) {
    // 3: not all flights are explained.
    assert.equal(thrown.status, 3, thrown.stderr);
    text = thrown.stdout;
  }
  const { findings, frames, flights } = JSON.parse(text);
  return told(findings.headline, frames.filter(({ image }) => image).map(({ time, image }) => ({ time, image })), flights);
}

async function byPackage() {
  const tracker = await VideoTracker.create({ camera: real.camera, scene: "free", ball: real.ball });
  const decode = ["-v", "error", "-i", clip, "-vf", "scale=in_color_matrix=auto:flags=accurate_rnd+full_chroma_int", "-f", "rawvideo", "-pix_fmt", "rgba", "-"];
  const pixels = execFileSync("ffmpeg", decode, { maxBuffer: 2 ** 30 });
  const size = 4 * WIDTH * HEIGHT;
  for (let frame = 0; frame < pixels.length / size; frame++) {
    const data = new Uint8ClampedArray(pixels.subarray(frame * size, (frame + 1) * size));
    await tracker.add({ data, width: WIDTH, height: HEIGHT }, (1000 * frame) / FPS);
  }
  const { findings, frames, flights } = await tracker.track({ timesKnown: true });
  tracker.dispose();
  return told(findings.headline, frames.filter(({ image }) => image), flights);
}

async function byPage() {
  const [server, browser] = await Promise.all([serve(), launch({ webgpu: false })]);
  try {
    const page = await open(browser, `${server.url}#video`, []);
    await page.getByTestId("video-real").click();
    await page.getByTestId("video-fit-words").waitFor(PATIENCE);
    await page.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
    const { frames, fit } = JSON.parse((await saved(page, "video-json")).toString());
    return told(await page.getByTestId("video-fit-words").textContent(), frames, fit.flights);
  } finally {
    await browser.close();
    await server.close();
  }
}

test("command, package and page say the same of a real clip", PATIENCE, async () => {
  const command = byCommand();
  assert.ok(command.frames.length >= 20 && command.flights.length >= 1, command.headline);
  for (const [who, other] of [["the package", await byPackage()], ["the page", await byPage()]]) {
    assert.equal(other.headline, command.headline, who);
    assert.equal(other.frames.length, command.frames.length, who);
    const offs = other.frames.map(({ image }, index) => Math.hypot(...image.map((px, axis) => px - command.frames[index].image[axis]))).sort((a, b) => a - b);
    assert.ok(offs[offs.length >> 1] < USUAL, `${who}: ${offs}`);
    for (const [index, { time, image }] of other.frames.entries()) {
      const expected = command.frames[index];
      const off = Math.hypot(image[0] - expected.image[0], image[1] - expected.image[1]);
      assert.ok(Math.abs(time - expected.time) < 1e-3 && off < PIXELS, `${who}: ${image} px at ${time} s, not ${expected.image} at ${expected.time}`);
    }
    for (const [index, { explained, speed }] of other.flights.entries()) {
      assert.equal(explained, command.flights[index].explained, who);
      assert.ok(Math.abs(speed / command.flights[index].speed - 1) < SPEEDS, `${who}: ${speed} m/s, not ${command.flights[index].speed}`);
    }
  }
});
