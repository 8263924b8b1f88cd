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
  const words = await page.getByTestId("video-fit-result").innerText();
  console.log(`${seconds.toFixed(0)} s; ${JSON.stringify(fit.findings).slice(0, 1500)}; ${words}`);
  assert.ok(fit.explained && !fit.flat, "its flight is explained, in metres");
  assert.equal(camera.width, 1920);
  assert.deepEqual(await axe(page, '[data-part="video-step"]'), []);
  await page.close();
});
