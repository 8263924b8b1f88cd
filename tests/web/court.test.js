/** From a frame without a camera to a position: the step Your video asks Calibrate, clicks and the court's lines answer. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { axe, launch, open, saved, value } from "./support/browser.js";
import { gravisight } from "./support/command.js";
import { jsonFile, pngFile } from "./support/demo.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 60_000 };
const complaints = [];
let server, browser, page, frame, truth, points;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  const folder = mkdtempSync(join(tmpdir(), "gravisight-court-"));
  gravisight(["synth", "--set", "broadcast", "--split", "val", "--clips", "1", "--out", folder]);
  truth = JSON.parse(readFileSync(join(folder, "volleyball-000.camera.json"), "utf8"));
  frame = execFileSync("ffmpeg", ["-v", "error", "-i", join(folder, "volleyball-000.mp4"), "-frames:v", "1", "-f", "image2pipe", "-c:v", "png", "-"], { maxBuffer: 2 ** 26 });
  points = await clicked("volleyball");
  page = await open(browser, `${server.url}#video`, complaints);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("a frame without a camera is handed to Calibrate, with the court of the place that was chosen", async () => {
  await page.getByTestId("video-sport").selectOption("volleyball");
  await page.getByTestId("video-input").setInputFiles([pngFile("court.png", frame)]);
  await page.getByTestId("video-calibrate").click();
  await page.getByTestId("cal-picture-name").filter({ hasText: `a frame of court.png, ${truth.width} × ${truth.height}` }).waitFor(PATIENCE);
  await page.getByTestId("cal-point-0").waitFor(PATIENCE);
  assert.equal(await page.getByTestId("cal-court").inputValue(), "volleyball");
  assert.match(await page.getByTestId("cal-use").textContent(), /go back/);
});

test("six clicks two pixels off and the court's lines give its camera", async () => {
  await page.getByTestId("cal-load").setInputFiles([jsonFile(points, "points.json")]);
  await page.getByTestId("cal-lines").filter({ hasText: /Refined with \d of the \d painted lines/ }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("cal-doubts").textContent(), "");
  const found = JSON.parse(await saved(page, "cal-save"));
  const [focal, expected] = [found, truth].map(({ intrinsic }) => intrinsic[0][0]);
  assert.ok(Math.abs(focal / expected - 1) < 0.004, `${focal} px, ${expected}`);
  assert.deepEqual(await axe(page, '[data-part="cal-drop"], .cal-result'), []);
});

test("lines that the picture does not show are said, and the clicks alone count", async () => {
  const elsewhere = { ...points, image: points.image.map(([x, y]) => [x, y - 150]) };
  await page.getByTestId("cal-load").setInputFiles([jsonFile(elsewhere, "points.json")]);
  await page.getByTestId("cal-lines").filter({ hasText: "From the clicks only" }).waitFor(PATIENCE);
  const text = await page.getByTestId("cal-lines").textContent();
  assert.match(text, /^From the clicks only: the painted lines could not be used\. Of \d painted lines, .*\.$/);
  assert.doesNotMatch(text, /calibration:|; |\blines: /);
  assert.ok(await page.getByTestId("cal-use").isEnabled());
  await page.getByTestId("cal-undo").click();
  await page.getByTestId("cal-lines").filter({ hasText: "Refined with" }).waitFor(PATIENCE);
});

test("the camera goes back to the step that asked for it", async () => {
  await page.getByTestId("cal-use").click();
  await page.waitForFunction(() => location.hash === "#video");
  await page.getByTestId("video-place").filter({ hasText: new RegExp(`Camera: calibrated on a frame of court\\.png, .*${truth.width} × ${truth.height} px`) }).waitFor(PATIENCE);
  assert.ok(await page.getByTestId("video-needs-camera").isHidden());
  await page.waitForFunction(() => document.querySelector('[data-part="video-processed"]').value === "1", null, { timeout: 120_000 });
  assert.equal(await page.getByTestId("video-alert").textContent(), "");
  assert.ok((await value(page, "video-processed")) === 1);
});

test("a court that was chosen in Calibrate is the place in Your video, if none was chosen there", async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  await own.getByTestId("video-input").setInputFiles([pngFile("court.png", frame)]);
  assert.equal(await own.getByTestId("video-sport").inputValue(), "");
  await own.getByTestId("video-calibrate").click();
  await own.getByTestId("cal-picture-name").filter({ hasText: "a frame of court.png" }).waitFor(PATIENCE);
  await own.getByTestId("cal-load").setInputFiles([jsonFile(points, "points.json")]);
  await own.locator('[data-part="cal-use"]:enabled').click({ ...PATIENCE });
  await own.getByTestId("video-place").filter({ hasText: /Scene: ball 2\d\.\d cm across, a floor/ }).waitFor(PATIENCE);
  assert.equal(await own.getByTestId("video-sport").inputValue(), "volleyball");
  // A place that was chosen stays.
  await own.getByTestId("video-sport").selectOption("tennis");
  await own.evaluate(() => (location.hash = "calibrate"));
  await own.getByTestId("cal-use").click();
  await own.getByTestId("cal-said").filter({ hasText: "now use this camera" }).waitFor();
  await own.evaluate(() => (location.hash = "video"));
  assert.equal(await own.getByTestId("video-sport").inputValue(), "tennis");
  // Kept with the camera.
  await own.reload();
  await own.getByTestId("video-place").filter({ hasText: /Scene: ball 2\d\.\d cm across/ }).waitFor(PATIENCE);
  await own.context().close();
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

/** A points.json of up to six points of a court's floor that the picture shows, clicked two pixels off. */
async function clicked(court) {
  const harness = await open(browser, `${server.url}harness.html`, complaints);
  const seen = await harness.evaluate(async ([camera, court]) => {
    const toolbox = await window.gravisight.Toolbox.create();
    const all = Object.entries((await toolbox.court(court)).points).filter(([, [, , z]]) => z === 0);
    const images = await toolbox.project(camera, all.map(([, place]) => place));
    toolbox.dispose();
    return all.map(([name], index) => ({ name, at: images[index] }));
  }, [truth, court]);
  await harness.close();
  const { width, height } = truth;
  const within = seen.filter(({ at }) => at && at[0] > 2 && at[1] > 2 && at[0] < width - 3 && at[1] < height - 3).slice(0, 6);
  assert.ok(within.length >= 4, `${within.length} points are seen`);
  const image = within.map(({ at: [x, y] }, index) => [x + (index % 2 ? 2 : -2), y + (index % 3 ? 1 : -2)]);
  return { width, height, court, names: within.map(({ name }) => name), image };
}
