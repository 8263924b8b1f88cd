/** What holds in Chromium holds in Firefox: positions, memory, aborts, fine-tuning, and that every step of the page opens. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { pictureOf, samples } from "./support/demo.js";
import { launchFirefox, openInFirefox } from "./support/firefox.js";
import { abortARun, fineTune, prepareSoak, soak, throwOne } from "./support/in-page.js";
import { serve } from "./support/server.js";

const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));
const CARD = "models/sd-l.json";
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launchFirefox();
  page = await openInFirefox(browser, `${server.url}harness.html`, complaints);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("the page finds the first sample's ball where the command finds it, and every step opens", async () => {
  const demo = await openInFirefox(browser, `${server.url}?model=models/sd-l.json`, complaints);
  await demo.waitForFunction(() => document.querySelector('[data-part="world-x"]')?.getAttribute("value"), { timeout: 120_000 });
  for (const [axis, name] of ["x", "y", "z"].entries()) {
    const value = Number(await demo.$eval(`[data-part="world-${name}"]`, (output) => output.getAttribute("value")));
    assert.ok(Math.abs(value - golden[samples[0].file].world[axis]) < 1e-3, `${name}: ${value}`);
  }
  for (const step of ["video", "calibrate", "label", "tune"]) {
    await demo.click(`#tab-${step}`);
    await demo.waitForSelector(`#panel-${step}:not([hidden]) button`);
    assert.equal(await demo.$eval(`#panel-${step}`, (panel) => panel.querySelector('[role="alert"]:not(:empty)')?.textContent ?? ""), "");
  }
  await demo.close();
});

test("an aborted run rejects with the signal's reason, and the next one is served", async () => {
  const base64 = pictureOf(samples[2]).toString("base64");
  const { aborted, served } = await page.evaluate(abortARun, { model: CARD, camera: samples[2].camera, base64 });
  assert.deepEqual(aborted, [true, true, true]);
  assert.equal(served, 3);
});

test("a thrown ball's track is fitted", async () => {
  const { worst, explained } = await page.evaluate(throwOne);
  assert.ok(explained && worst < 0.03, `off by ${worst} m`);
});

test("fine-tuning cuts the distance to the truth to a third", { timeout: 600_000 }, async () => {
  const { before, after, seconds } = await page.evaluate(fineTune, { model: "models/sd-s.json", steps: 60 });
  console.log(`held-out forecast error ${before.forecastPx} -> ${after.forecastPx} px, DtG ${before.dtg.mean} -> ${after.dtg.mean} m, ${seconds} s`);
  assert.ok(after.forecastPx < before.forecastPx);
  assert.ok(after.dtg.mean < 1.3 * 0.127);
});

test("two thousand frames take no more memory of the core than the first hundred", { timeout: 300_000 }, async () => {
  await page.evaluate(prepareSoak, { model: CARD, camera: samples[0].camera });
  const first = await page.evaluate(soak, { from: 1, to: 100 });
  const last = await page.evaluate(soak, { from: 101, to: 2000 });
  assert.ok(Math.abs(last - first) <= 2e6, `${first} to ${last} bytes`);
});

test("nothing was reported to the console", () => {
  assert.deepEqual(complaints, []);
});
