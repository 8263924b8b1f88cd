/** Step Fine-tune of the page before a run: which clips are used, and which are refused. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open } from "./support/browser.js";
import { changeStored, storedIn } from "./support/in-page.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 120_000 };
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#tune`, complaints);
  await page.getByTestId("tune-empty").waitFor(PATIENCE);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

const row = (id) => page.getByTestId("tune-clips").locator("li").filter({ hasText: id });
const start = async (refusal) => {
  await page.getByTestId("tune-start").click();
  await page.getByTestId("tune-alert").filter({ hasText: refusal }).waitFor(PATIENCE);
};

test("a clip that is labelled later is used by itself; what is missing is named", { timeout: 180_000 }, async () => {
  await page.locator("#tab-label").click();
  await page.getByTestId("lab-number").fill("3");
  await page.getByTestId("lab-synth").click();
  await page.getByTestId("lab-title").filter({ hasText: "env1/cam1/0003" }).waitFor(PATIENCE);
  await row("0003").waitFor({ state: "attached", ...PATIENCE });
  await page.getByTestId("lab-propose").click();
  await page.getByTestId("lab-said").filter({ hasText: "The ball was found in" }).waitFor(PATIENCE);
  await page.getByTestId("lab-accept-sure").click();
  await page.getByTestId("lab-held").check();
  await page.waitForTimeout(1200);
  await page.locator("#tab-tune").click();
  assert.ok(await row("0003").getByTestId("tune-use").isChecked());
  assert.ok(await row("0003").getByTestId("tune-held-out").isChecked());
  await start("Choose at least one clip to learn from");
  await page.getByTestId("tune-example").click();
  await page.getByTestId("tune-status").filter({ hasText: "Five clips are ready" }).waitFor(PATIENCE);
  // Only clips that are held out and not in use are left.
  for (const id of ["0003", "throw 5"]) await row(id).getByTestId("tune-use").uncheck();
  await start("is held out, but not ticked “use”");
  for (const id of ["0003", "throw 5"]) await row(id).getByTestId("tune-held-out").uncheck();
  await page.waitForTimeout(500);
  await start("Hold one clip out: tick “held out” on a clip in use");
});

test("clips of one's own start from the model for any ball, the examples from that of their scene", async () => {
  assert.equal(await page.getByTestId("tune-model").inputValue(), "sd-s");
  await page.evaluate(changeStored, ["clip Example, camera 2, throw 1", { truth: null }]);
  await page.reload();
  await row("throw 1").waitFor(PATIENCE);
  assert.equal(await page.getByTestId("tune-model").inputValue(), "any");
});

test("a clip that physics does not explain, or that lacks something, is refused at once, by name", PATIENCE, async () => {
  const id = "Example, camera 2, throw 2";
  const { labels } = await page.evaluate(storedIn, `clip ${id}`);
  // As if it were hit to and fro, by nothing that the scene holds.
  await page.evaluate(changeStored, [`clip ${id}`, { labels: labels.map((label, frame) => label && [label[0] + 25 * Math.sin(frame), label[1]]) }]);
  await page.reload();
  await row("throw 5").getByTestId("tune-use").check();
  await row("throw 5").getByTestId("tune-held-out").check();
  await page.waitForTimeout(500);
  const begun = Date.now();
  await start(`Physics does not explain the labels of “${id}”`);
  const seconds = (Date.now() - begun) / 1000;
  assert.ok(seconds < 30, `${seconds} s`);
  assert.match(await page.getByTestId("tune-alert").textContent(), /cut a clip with hits or catches into flights\. Otherwise, check its labels/);
  assert.ok(await page.getByTestId("tune-scores").isHidden());
  await page.evaluate(changeStored, [`clip ${id}`, { camera: null }]);
  await page.reload();
  await row("throw 2").filter({ hasText: "no camera" }).waitFor(PATIENCE);
  await row("throw 2").getByTestId("tune-use").check();
  await row("throw 5").getByTestId("tune-use").check();
  await start(`“${id}” lacks its camera`);
});

test("axe finds nothing to complain of, in light and in dark, and a phone shows it without scrolling sideways", PATIENCE, async () => {
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    for (const width of [1280, 390]) {
      await page.setViewportSize({ width, height: 860 });
      assert.deepEqual(await axe(page, "#panel-tune"), [], `${colorScheme}, ${width}`);
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px`);
    }
  }
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));
