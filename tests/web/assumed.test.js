/** Without a calibration: a phone is assumed, held level, in the steps Your video and Try. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { axe, launch, open, saved } from "./support/browser.js";
import { drop, forget, jsonFile, located, pictureOf, pngFile, ready, samples, shown } from "./support/demo.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 180_000 };
const clip = readFileSync(new URL("../../web/public/real/toss_wall.mp4", import.meta.url));
const photo = readFileSync(new URL("../../web/public/real/toss_wall.jpg", import.meta.url));
const complaints = [];
let server, browser;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("a video and nothing else becomes a speed in metres a second with its uncertainty, within a minute", PATIENCE, async () => {
  const page = await open(browser, `${server.url}#video`, complaints);
  const started = Date.now();
  await page.getByTestId("video-input").setInputFiles([{ name: "toss_wall.mp4", mimeType: "video/mp4", buffer: clip }]);
  await page.getByTestId("video-needs-camera").waitFor(PATIENCE);
  await page.getByTestId("video-sport").selectOption("free");
  await page.getByTestId("video-assume").click();
  await page.getByTestId("video-assumed").waitFor(PATIENCE);
  const note = await page.getByTestId("video-assumed-note").innerText();
  assert.match(note, /Assumed, not measured\. The main camera of a phone, 26 mm.*± \d+ px.*5°.*2°.*1\.5 ± 0\.2 m/);
  assert.ok(await page.getByTestId("video-needs-camera").isHidden());
  await page.getByTestId("video-ball").fill("6.7");
  await page.getByTestId("video-ball").dispatchEvent("change");
  await page.getByTestId("video-place").filter({ hasText: "6.7 cm across" }).waitFor(PATIENCE);
  await page.getByTestId("video-track").click();
  await page.getByTestId("video-fit-result").waitFor(PATIENCE);
  const seconds = (Date.now() - started) / 1000;
  const { fit, camera } = JSON.parse((await saved(page, "video-json")).toString());
  assert.ok(fit.explained && !fit.flat, "its flight is explained, in metres");
  assert.equal(camera.width, 1920);
  const result = await page.getByTestId("video-fit-result").innerText();
  const [, value, sigma] = result.match(/(\d+\.\d+)\sm\/s [^±]*± (\d+(?:\.\d+)?)/) ?? [];
  console.log(`toss_wall with an assumed phone: ${value} ± ${sigma} m/s after ${seconds.toFixed(0)} s`);
  // By a phone of exactly 26 mm it is 4.58 m/s.
  assert.ok(Math.abs(value - 4.58) < 3 * sigma && sigma > 0.02 && sigma < 0.2 * value, result);
  assert.ok(seconds < 60, `${seconds} s`);
  assert.ok(await page.getByTestId("video-assumed").isVisible(), "what was assumed stands beside the result");
  assert.deepEqual(await axe(page, '[data-part="video-step"]'), []);
  await page.getByTestId("video-assume-not").click();
  await page.getByTestId("video-needs-camera").waitFor();
  assert.ok(await page.getByTestId("video-assumed").isHidden());
  await page.close();
});

test("a court is left out for a phone that is assumed, and its ball stays", PATIENCE, async () => {
  const page = await open(browser, `${server.url}#video`, complaints);
  await page.getByTestId("video-input").setInputFiles([{ name: "ball.jpg", mimeType: "image/jpeg", buffer: photo }]);
  await page.getByTestId("video-needs-camera").waitFor(PATIENCE);
  await page.getByTestId("video-sport").selectOption("tennis");
  await page.getByTestId("video-place").filter({ hasText: "6.7 cm across" }).waitFor(PATIENCE);
  const ball = await page.getByTestId("video-ball").inputValue();
  await page.getByTestId("video-assume").click();
  await page.getByTestId("video-assumed-note").filter({ hasText: "The court is left out" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("video-sport").inputValue(), "free");
  assert.equal(await page.getByTestId("video-ball").inputValue(), ball);
  await page.getByTestId("video-sigma").filter({ hasText: "±" }).waitFor(PATIENCE);
  await page.close();
});

/** A JPEG with an EXIF block that states a 35 mm equivalent. */
function withFocal(jpeg, millimetres) {
  const tiff = Buffer.alloc(26 + 18);
  tiff.write("MM\0*", 0, "latin1");
  tiff.writeUInt32BE(8, 4);
  // IFD0: a pointer to the EXIF block; there: FocalLengthIn35mmFilm, a short.
  const entry = (at, tag, type, value) => {
    tiff.writeUInt16BE(1, at);
    tiff.writeUInt16BE(tag, at + 2);
    tiff.writeUInt16BE(type, at + 4);
    tiff.writeUInt32BE(1, at + 6);
    if (type === 3) tiff.writeUInt16BE(value, at + 10);
    else tiff.writeUInt32BE(value, at + 10);
  };
  entry(8, 0x8769, 4, 26);
  entry(26, 0xa405, 3, millimetres);
  const content = Buffer.concat([Buffer.from("Exif\0\0", "latin1"), tiff]);
  const head = Buffer.from([0xff, 0xe1, 0, 0]);
  head.writeUInt16BE(content.length + 2, 2);
  return Buffer.concat([jpeg.subarray(0, 2), head, content, jpeg.subarray(2)]);
}

test("a photograph and nothing else becomes a position with its uncertainty, by the lens that the file states", PATIENCE, async () => {
  const page = await open(browser, server.url, complaints);
  await located(page);
  const [plainDepth] = await shown(page, "depth");
  const jpeg = (buffer) => ({ name: "ball.jpg", mimeType: "image/jpeg", buffer });
  await drop(page, jpeg(photo));
  await page.getByTestId("alert").filter({ hasText: "Assume a phone" }).waitFor(PATIENCE);
  await forget(page);
  await page.getByTestId("assume-phone").click();
  await located(page);
  assert.match(await page.getByTestId("notes").innerText(), /Assumed, not measured\. The main camera of a phone, 26 mm.*1\.5 ± 0\.2 m above the ground/s);
  const [depth] = await shown(page, "depth");
  const [sigma] = await shown(page, "sigma");
  // By diagonals, and not by widths, as the sample's camera was assumed: 4 % farther.
  assert.ok(Math.abs(depth / plainDepth - 1.04) < 0.03, `${depth} m, ${plainDepth} m`);
  assert.ok(sigma > 0.08 * depth && sigma < 0.4 * depth, `${sigma} m of ${depth} m`);
  await forget(page);
  await drop(page, jpeg(withFocal(photo, 52)));
  await located(page);
  assert.match(await page.getByTestId("notes").innerText(), /52 mm equivalent, which the file/);
  const [twice] = await shown(page, "depth");
  // The ball is blurred: how its edge is refined depends on the camera a little.
  assert.ok(Math.abs(twice / depth - 2) < 0.08, `${twice} m with twice the focal length, ${depth} m before`);
  // A camera file counts more than the assumption.
  await forget(page);
  await drop(page, jpeg(photo), jsonFile({ width: 960, height: 540, intrinsic: [[693.3, 0, 479.5], [0, 693.3, 269.5], [0, 0, 1]], camera_from_world: [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]] }));
  await located(page);
  assert.doesNotMatch(await page.getByTestId("notes").innerText(), /Assumed/);
  assert.equal(await page.getByTestId("assume-phone").getAttribute("aria-pressed"), "false");
  await page.close();
});

test("what a calibration prints is taken as a camera, and its uncertainty enters the position's", PATIENCE, async () => {
  const page = await open(browser, server.url, complaints);
  await located(page);
  const { camera } = samples[0];
  const moved = { ...camera, camera_from_world: camera.camera_from_world.map((row, axis) => (axis === 2 ? [...row.slice(0, 3), row[3] + 0.5] : row)) };
  const sigmas = [];
  for (const content of [camera, { camera, oneSigma: [moved] }, { camera, one_sigma: [moved], rms_px: 0.4 }]) {
    await forget(page);
    await drop(page, pngFile("own.png", pictureOf(samples[0])), jsonFile(content, "calibration.json"));
    await located(page);
    await ready(page);
    sigmas.push((await shown(page, "sigma"))[0]);
  }
  assert.ok(sigmas[1] > sigmas[0] + 0.1 && sigmas[1] === sigmas[2], sigmas.join());
  await page.goto(`${server.url}#video`);
  await page.getByTestId("video-input").setInputFiles([jsonFile({ camera, one_sigma: [moved] }, "calibration.json")]);
  await page.getByTestId("video-place").filter({ hasText: "calibration.json, 224 × 224 px" }).waitFor(PATIENCE);
  await page.close();
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});
