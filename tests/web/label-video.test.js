/** Step Label of the page with a video of one's own: its times, without a camera and with one, cut into flights. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open, saved } from "./support/browser.js";
import { jsonFile } from "./support/demo.js";
import { film } from "./support/film.js";
import { changeStored, drawThrow, storedIn } from "./support/in-page.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 120_000 };
const complaints = [];
let server, browser, page, made;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  const filming = await open(browser, `${server.url}harness.html`, complaints);
  made = await filming.evaluate(drawThrow);
  const { width, height } = made.camera;
  made.film = await film(filming, { ...made, width, height });
  made.spoilt = await film(filming, { ...made, width, height, spoilt: 31 });
  await filming.close();
  page = await open(browser, `${server.url}#label`, complaints);
  await page.getByTestId("lab-synth").waitFor(PATIENCE);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

const text = (name) => page.getByTestId(name).textContent();
const stored = (id) => page.evaluate(storedIn, `clip ${id}`);
const take = async (name, buffer) => {
  await page.getByTestId("lab-files").setInputFiles([{ name, mimeType: "video/webm", buffer }]);
  await page.getByTestId("lab-title").filter({ hasText: name.replace(/\..*/, "") }).waitFor(PATIENCE);
};
const propose = async () => {
  await page.getByTestId("lab-propose").click();
  await page.getByTestId("lab-said").filter({ hasText: "The ball was found in" }).waitFor(PATIENCE);
};

test("a video's frames keep the times of the file, whatever the rate for pictures is", PATIENCE, async () => {
  await page.getByTestId("lab-fps").fill("7");
  await take("throw.webm", made.film);
  const clip = await stored("throw");
  assert.equal(clip.pictures.length, made.pictures.length);
  assert.deepEqual(clip.times.map((time) => Math.round(1000 * time)), made.pictures.map((_, index) => Math.round((1000 * index) / made.fps)));
  assert.ok(Math.abs(clip.fps - made.fps) < 0.2, `${clip.fps} a second`);
  assert.equal(await text("lab-alert"), "");
  await page.getByTestId("lab-most").fill("12");
  await take("start.webm", made.film);
  assert.equal((await stored("start")).pictures.length, 12);
  await page.getByTestId("lab-most").fill("300");
});

test("a video that is broken from a frame on is named, and its frames before that are used", PATIENCE, async () => {
  await take("spoilt.webm", made.spoilt);
  assert.match(await text("lab-alert"), /broken after \d\.\d\d s.*spoilt\.webm/);
  assert.equal((await stored("spoilt")).pictures.length, 31);
});

test("a browser without a decoder seeks, and says that the times may be wrong", PATIENCE, async () => {
  await page.evaluate(() => ([window.kept, window.VideoDecoder] = [window.VideoDecoder, undefined]));
  await page.getByTestId("lab-fps").fill("10");
  await page.getByTestId("lab-most").fill("4");
  await take("seeking.webm", made.film);
  await page.getByTestId("lab-alert").filter({ hasText: "seeking.webm cannot be decoded here, so the page took 10 frames a second" }).waitFor(PATIENCE);
  assert.deepEqual((await stored("seeking")).times, [0, 0.1, 0.2, 0.3]);
  await page.evaluate(() => (window.VideoDecoder = window.kept));
  await page.getByTestId("lab-most").fill("300");
});

test("without a camera a clip is proposed and labelled, in numbers that agree; only clips.jsonl is refused", PATIENCE, async () => {
  await page.getByTestId("lab-open-throw").click();
  await page.getByTestId("lab-clip-camera").filter({ hasText: "No camera yet" }).waitFor(PATIENCE);
  await propose();
  const [, found, all, sure, doubtful] = (await text("lab-said")).match(/found in (\d+) of (\d+) frames: (\d+) sure, (\d+) doubtful/).map(Number);
  const cells = (state) => page.locator(`.lab-strip [data-state="${state}"]`).count();
  assert.deepEqual([sure, doubtful, all - found], [await cells("sure"), await cells("doubtful"), await cells("open")]);
  assert.equal(all, made.pictures.length);
  assert.ok(found >= 0.5 * all, `${found} of ${all}`);
  assert.match(await text("lab-count"), new RegExp(`${sure} sure and ${doubtful} doubtful proposals to review · ${all - found} without a proposal`));
  await page.getByTestId("lab-accept-sure").click();
  const [header, first] = (await saved(page, "lab-save-csv")).toString().split("\n");
  assert.equal(header, "Frame,Visibility,X,Y,Time");
  const [frame, , , , time] = first.split(",").map(Number);
  assert.ok(Math.abs(time - frame / made.fps) < 0.002, first);
  await page.getByTestId("lab-save-jsonl").click();
  await page.getByTestId("lab-alert").filter({ hasText: "throw has no camera yet, and clips.jsonl needs one" }).waitFor(PATIENCE);
  assert.ok(await page.getByTestId("lab-cut").isDisabled());
});

test("camera, place and ball are set later, and kept with the clip; no ball is taken unasked", PATIENCE, async () => {
  assert.deepEqual([(await stored("throw")).scene, await page.getByTestId("lab-ball").inputValue()], [undefined, ""]);
  await page.getByTestId("lab-files").setInputFiles([jsonFile(made.camera)]);
  await page.getByTestId("lab-recamera").click();
  await page.getByTestId("lab-sport").selectOption("tennis");
  await page.getByTestId("lab-said").filter({ hasText: "6.7 cm across" }).waitFor(PATIENCE);
  await page.getByTestId("lab-sport").selectOption("free");
  await page.getByTestId("lab-ball").fill("40");
  await page.getByTestId("lab-ball").press("Enter");
  await page.getByTestId("lab-said").filter({ hasText: "40.0 cm across" }).waitFor(PATIENCE);
  await page.waitForTimeout(1200);
  const { scene, sport, camera } = await stored("throw");
  assert.deepEqual([scene.ball.radius, sport, camera.width], [0.2, "free", made.camera.width]);
  assert.equal(JSON.parse(await saved(page, "lab-save-jsonl")).scene.ball.radius, 0.2);
});

test("with camera, place and ball a clip is cut into its flights, which keep times and labels", PATIENCE, async () => {
  // No sport is played in the drawn room.
  await page.evaluate(changeStored, ["clip throw", { scene: made.scene, sport: null }]);
  await page.reload();
  await page.getByTestId("lab-title").filter({ hasText: /^throw$/ }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("lab-sport").inputValue(), "other");
  await propose();
  assert.match(await text("lab-flights"), /1 flight found; physics explains 1/);
  await page.getByTestId("lab-cut").click();
  await page.getByTestId("lab-said").filter({ hasText: "One clip was made" }).waitFor(PATIENCE);
  const [whole, flight] = [await stored("throw"), await stored("throw, flight 1")];
  const from = whole.times.indexOf(flight.times[0]);
  assert.ok(from >= 0 && flight.times.every((time, index) => time === whole.times[from + index]));
  const labelled = flight.labels.filter(Boolean).length;
  assert.ok(labelled >= 15 && flight.pictures.length === flight.times.length, `${labelled} labels`);
  assert.deepEqual([flight.scene.ball.radius, flight.heldOut], [0.2, false]);
  await page.getByTestId("lab-clip-throw, flight 1").filter({ hasText: `${labelled} of` }).waitFor(PATIENCE);
});

test("axe finds nothing to complain of, in light and in dark, and a phone shows it without scrolling sideways", PATIENCE, async () => {
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    for (const width of [1280, 390]) {
      await page.setViewportSize({ width, height: 860 });
      assert.deepEqual(await axe(page, "#panel-label"), [], `${colorScheme}, ${width}`);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px`);
    }
  }
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));
