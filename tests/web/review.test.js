/** Reviewing a tracked video: frame by frame, by marks, rows and keys; and that no work is lost. Real footage, but where a bounce is needed. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { launch, open, saved, value } from "./support/browser.js";
import { jsonFile, real } from "./support/demo.js";
import { serve } from "./support/server.js";

/** The model and the clip take this long at most, on a busy machine. */
const PATIENCE = { timeout: 120_000 };
const clip = { name: "toss_wall.mp4", mimeType: "video/mp4", buffer: readFileSync(new URL("../../web/public/real/toss_wall.mp4", import.meta.url)) };
const complaints = [];
let server, browser, page, frames;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#video`, complaints);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

/** Tracks the video that is open. */
async function tracked(own) {
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  await own.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
  return JSON.parse((await saved(own, "video-json")).toString()).frames;
}

/** What the picture says once a step has settled: longer than a browser takes to tell of a seek. */
async function settled(own) {
  await own.waitForTimeout(100);
  await own.waitForFunction(() => !document.querySelector('[data-part="video-frame"] video').seeking, null, PATIENCE);
  await own.waitForTimeout(300);
  return { label: await own.getByTestId("video-overlay").getAttribute("aria-label"), clock: await own.getByTestId("video-clock").textContent() };
}

/** Pixels of the pixel that the picture's label names. */
const pixelOf = (label) => label.match(/pixel (\d+), (\d+)/)?.slice(1).map(Number);

test("stepping shows each frame once, each with the ball that was found in it", PATIENCE, async () => {
  await page.getByTestId("video-input").setInputFiles([clip]);
  frames = await tracked(page);
  assert.ok(frames.length >= 20, `${frames.length} frames`);
  for (const frame of frames.slice(0, 12)) {
    const { label } = await settled(page);
    const pixel = pixelOf(label);
    assert.ok(pixel, `at ${frame.time} s: ${label}`);
    assert.ok(distance(pixel, frame.image) < 1, `at ${frame.time} s the ring is at ${pixel}, not ${frame.image}`);
    await page.getByTestId("video-forward").click();
  }
});

test("scrubbing to anywhere within a frame shows that frame's ball", PATIENCE, async () => {
  const [first, second] = [frames[10], frames[11]];
  for (const fraction of [0.02, 0.5, 0.95]) {
    await scrub(page, 1000 * (first.videoTime + fraction * (second.videoTime - first.videoTime)));
    const { label } = await settled(page);
    assert.ok(distance(pixelOf(label) ?? [0, 0], first.image) < 1, label);
  }
});

test("arrow keys step wherever the focus is, Shift by ten frames; Space plays and pauses", PATIENCE, async () => {
  await scrub(page, 1000 * frames[0].videoTime);
  await settled(page);
  await page.getByTestId("video-time").focus();
  await page.keyboard.press("ArrowRight");
  assert.ok(distance(pixelOf((await settled(page)).label), frames[1].image) < 1, "on the slider, too");
  await page.keyboard.press("ArrowLeft");
  await settled(page);
  await page.getByTestId("video-overlay").focus();
  await page.keyboard.press("Shift+ArrowRight");
  const ten = frames.find(({ videoTime }) => videoTime > frames[0].videoTime + 9.5 / 30);
  assert.ok(distance(pixelOf((await settled(page)).label), ten.image) < 1);
  await page.keyboard.press("Space");
  await page.waitForFunction(() => document.querySelector('[data-part="video-play"]').dataset.playing === "true");
  await page.keyboard.press("Space");
  await page.waitForFunction(() => document.querySelector('[data-part="video-play"]').dataset.playing === "false");
});

test("a video that repeats frames shows the ring in all of them, and its times are those of filming", PATIENCE, async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  // As a broadcast of 25 frames a second shown at 30: each fifth picture comes twice.
  await own.getByTestId("video-input").setInputFiles([{ ...clip, name: "repeated.mp4", buffer: repeating(clip.buffer) }]);
  await tracked(own);
  const found = JSON.parse((await saved(own, "video-json")).toString());
  assert.ok(found.frames.length >= 15);
  let seen = 0;
  const steps = 16;
  for (let step = 0; step < steps; step++) {
    if (pixelOf((await settled(own)).label)) seen++;
    await own.getByTestId("video-forward").click();
  }
  assert.equal(seen, steps);
  await own.close();
});

test("a correction is listed, taken back, and made by keys", PATIENCE, async () => {
  await scrub(page, 1000 * frames[5].videoTime);
  await settled(page);
  await page.getByTestId("video-overlay").focus();
  await page.keyboard.press("Enter");
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Enter");
  await page.getByTestId("video-correction").waitFor(PATIENCE);
  await page.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
  assert.match(await page.getByTestId("video-corrections").textContent(), /Frame \d+: the ball is at pixel \d+, \d+/);
  await page.getByTestId("video-correction-undo").click();
  await page.getByTestId("video-corrections").waitFor({ state: "hidden", ...PATIENCE });
  await page.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
});

test("after a reload the video and its track are there again, and a saved file opens them elsewhere", PATIENCE, async () => {
  const work = await saved(page, "video-save-session");
  const before = JSON.parse((await saved(page, "video-json")).toString());
  await page.reload();
  await page.getByTestId("video-fit-words").waitFor(PATIENCE);
  await page.getByTestId("video-session").filter({ hasText: "Your work on this video" }).waitFor(PATIENCE);
  assert.deepEqual(JSON.parse((await saved(page, "video-json")).toString()).frames, before.frames);
  assert.ok(pixelOf((await settled(page)).label), "the ring is in the picture");
  const own = await open(browser, `${server.url}#video`, complaints, { storageState: undefined });
  await own.getByTestId("video-input").setInputFiles([{ name: "toss_wall.gravisight.json", mimeType: "application/json", buffer: work }]);
  await own.getByTestId("video-session").filter({ hasText: "Open the video again" }).waitFor(PATIENCE);
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  assert.deepEqual(JSON.parse((await saved(own, "video-json")).toString()).frames, before.frames);
  await own.getByTestId("video-input").setInputFiles([clip]);
  await own.getByTestId("video-session").filter({ hasText: "Your work on this video" }).waitFor(PATIENCE);
  assert.ok(pixelOf((await settled(own)).label), "the ring is in the picture");
  await own.getByTestId("video-input").setInputFiles([jsonFile({ format: "gravisight-session", version: 1 }, "half.gravisight.json")]);
  await own.getByTestId("video-alert").filter({ hasText: "half.gravisight.json is damaged" }).waitFor(PATIENCE);
  await own.close();
});

test("a track stays when the camera changes elsewhere, until it is computed again", PATIENCE, async () => {
  const before = await value(page, "video-processed");
  await page.evaluate(() => (location.hash = "label"));
  await page.getByTestId("lab-files").setInputFiles([jsonFile(real.camera)]);
  await page.getByTestId("lab-camera").filter({ hasText: "960" }).waitFor(PATIENCE);
  await page.evaluate(() => (location.hash = "video"));
  await page.getByTestId("video-sport").selectOption("free");
  await page.getByTestId("video-stale").waitFor(PATIENCE);
  assert.equal(await value(page, "video-processed"), before);
  assert.ok(await page.getByTestId("video-fit-words").isVisible());
  await page.getByTestId("video-ball").fill("6.7");
  await page.getByTestId("video-ball").dispatchEvent("change");
  await page.getByTestId("video-retrack").click();
  await page.getByTestId("video-stale").waitFor({ state: "hidden", ...PATIENCE });
  await page.getByTestId("video-flights").waitFor(PATIENCE);
});

test("a camera that was found on another video is used only once a person has confirmed it", PATIENCE, async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  await own.evaluate((camera) => {
    localStorage.setItem("gravisight.camera", JSON.stringify(camera));
    localStorage.setItem("gravisight.camera-about", JSON.stringify({ from: "calibrated on a frame of match.mp4", of: ["match.mp4"], at: "2026-01-02T10:00:00Z" }));
  }, real.camera);
  await own.reload();
  await own.getByTestId("video-input").setInputFiles([clip]);
  await own.getByTestId("video-other-camera").waitFor(PATIENCE);
  assert.match(await own.getByTestId("video-other-camera").innerText(), /calibrated on a frame of match\.mp4, 2 Jan 2026/);
  assert.match(await own.getByTestId("video-track-why").innerText(), /In pixels/);
  await own.getByTestId("video-other-camera-use").click();
  await own.getByTestId("video-other-camera").waitFor({ state: "hidden", ...PATIENCE });
  assert.match(await own.getByTestId("video-place").innerText(), /calibrated on a frame of match\.mp4.*960 × 540/);
  await own.getByTestId("video-forget-camera").click();
  await own.getByTestId("video-needs-camera").waitFor(PATIENCE);
  assert.equal(await own.evaluate(() => localStorage.getItem("gravisight.camera")), null);
  await own.close();
});

test("bounces and hits are marks on the slider; a mark, a row, the plan and a plot go to their moment", PATIENCE, async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  await own.getByTestId("video-rally").click();
  await own.getByTestId("video-contacts").waitFor(PATIENCE);
  await own.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
  const moments = await own.getByTestId("video-contacts").getByTestId("video-moment").evaluateAll((buttons) => buttons.map(({ dataset }) => Number(dataset.time)));
  const marks = own.getByTestId("video-mark");
  assert.ok((await marks.count()) >= moments.length && moments.length >= 3, `${await marks.count()} marks, ${moments.length} rows`);
  const reached = async (seconds) => {
    const { clock } = await settled(own);
    assert.ok(Math.abs(parseFloat(clock) - seconds) < 0.06, `${clock}, not ${seconds} s`);
  };
  await own.getByTestId("video-contacts").getByTestId("video-moment").nth(1).click();
  await reached(moments[1]);
  await marks.first().click();
  await reached(Number(await marks.first().getAttribute("data-time")));
  const spot = own.getByTestId("video-plan").locator("[data-time]").last();
  await spot.locator("circle").click();
  await reached(Number(await spot.getAttribute("data-time")));
  const plot = own.getByTestId("video-chart-speed").locator(".u-over");
  const { width, height } = await plot.boundingBox();
  await plot.click({ position: { x: width / 2, y: height / 2 } });
  const clock = parseFloat((await settled(own)).clock);
  const [, from, to] = (await own.getByTestId("video-chart-speed").getAttribute("aria-label")).match(/([\d.]+) to ([\d.]+):/);
  assert.ok(Math.abs(clock - (Number(from) + Number(to)) / 2) < 0.1, `${clock} s`);
  // In other units the same numbers.
  const speedOf = async () => parseFloat(await own.getByTestId("video-flight").first().locator("strong").first().innerText());
  const metric = await speedOf();
  await own.getByTestId("video-units").selectOption("mph");
  assert.ok(Math.abs((await speedOf()) * 0.44704 - metric) < 0.06, `${await speedOf()} mph, ${metric} m/s`);
  assert.match(await own.getByTestId("video-chart-speed").getAttribute("aria-label"), /\(mph\)/);
  assert.match(await own.getByTestId("video-contacts").innerText(), / ft/);
  await own.getByTestId("video-units").selectOption("si");
  // What can be taken along.
  const report = (await saved(own, "video-report")).toString();
  assert.match(report, /<h1>tennis\.mp4<\/h1>/);
  assert.match(report, /All \d flights are explained.*<caption>Bounces and hits<\/caption>.*<svg.*data:image\/png/s);
  assert.doesNotMatch(report, /<script|<button|https?:\/\/(?!www\.w3\.org)/);
  const film = join(mkdtempSync(join(tmpdir(), "gravisight-film-")), "film");
  writeFileSync(film, await saved(own, "video-film"));
  const entries = ["-v", "error", "-count_frames", "-select_streams", "v", "-show_entries", "stream=width,height,nb_read_frames", "-of", "csv=p=0", film];
  assert.deepEqual(execFileSync("ffprobe", entries).toString().trim().split(",").map(Number), [1920, 1080, 97]);
  await own.close();
});

test("a video that the browser cannot play, and one that is cut off, are named", PATIENCE, async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  const hevc = { ...clip, name: "IMG_0042.MOV", mimeType: "video/quicktime", buffer: converted(clip.buffer, ["-an", "-c:v", "libx265", "-x265-params", "log-level=none", "-preset", "ultrafast", "-tag:v", "hvc1"]) };
  for (const [step, input, alert] of [["video", "video-input", "video-alert"], ["calibrate", "cal-file", "cal-alert"], ["label", "lab-files", "lab-alert"]]) {
    await own.evaluate((step) => (location.hash = step), step);
    await own.getByTestId(input).waitFor({ state: "attached", ...PATIENCE });
    await own.getByTestId(input).setInputFiles([hevc]);
    await own.getByTestId(alert).filter({ hasText: /IMG_0042\.MOV is HEVC .* Most Compatible .*ffmpeg -i/ }).waitFor(PATIENCE);
  }
  await own.evaluate(() => (location.hash = "video"));
  const whole = converted(clip.buffer, ["-c", "copy", "-movflags", "faststart"]);
  await own.getByTestId("video-input").setInputFiles([{ ...clip, buffer: whole.subarray(0, 0.6 * whole.length) }]);
  await tracked(own);
  assert.match(await own.getByTestId("video-fit-result").innerText(), /toss_wall\.mp4 is cut off after [\d.]+ s: only \d+ of its 27 frames can be read/);
  await own.close();
});

test("nothing was reported to the console", () => assert.deepEqual(complaints, []));

function distance(a, b) {
  return Math.hypot(...a.map((coordinate, axis) => coordinate - b[axis]));
}

/** Moves the slider. */
async function scrub(own, ms) {
  await own.getByTestId("video-time").evaluate((slider, ms) => {
    slider.value = String(ms);
    slider.dispatchEvent(new Event("input"));
  }, ms);
}

/** The same clip as one of 25 frames a second that is shown at 30: every sixth picture is the one before again. */
function repeating(video) {
  return converted(video, ["-vf", "setpts=N/25/TB,fps=30", "-an", "-c:v", "libx264", "-crf", "12"]);
}

function converted(video, options) {
  const folder = mkdtempSync(join(tmpdir(), "gravisight-repeat-"));
  const [from, to] = ["from.mp4", "to.mp4"].map((name) => join(folder, name));
  try {
    writeFileSync(from, video);
    execFileSync("ffmpeg", ["-v", "error", "-i", from, ...options, to]);
    return readFileSync(to);
  } finally {
    rmSync(folder, { recursive: true });
  }
}
