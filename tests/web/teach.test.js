/** Your video: a model is taught the ball of a video that was tracked, through a reload, and is kept; what holds too little is refused in words. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { axe, launch, open } from "./support/browser.js";
import { storedIn } from "./support/in-page.js";
import { serve } from "./support/server.js";

/** The frames are looked at twice, on a machine that may be busy. */
const PATIENCE = { timeout: 600_000 };
const video = (path) => ({ name: path.split("/").at(-1), mimeType: "video/mp4", buffer: readFileSync(new URL(`../../web/public/${path}`, import.meta.url)) });
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#video`, complaints);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

async function tracked(file) {
  await page.getByTestId("video-input").setInputFiles([file]);
  await page.getByTestId("video-track").click();
  await page.getByTestId("video-fit-words").waitFor(PATIENCE);
  await page.getByTestId("video-job").waitFor({ state: "hidden", ...PATIENCE });
}

/** The first step from `least` on that the page shows; steps are fast, and some of them are never seen. */
async function training(least) {
  const shown = (least) => {
    const [, step] = document.querySelector('[data-part="video-job"]').textContent.match(/Training the .*: step (\d+) of 75 in total/) ?? [];
    return Number(step) >= least && Number(step);
  };
  return (await page.waitForFunction(shown, least, PATIENCE)).jsonValue();
}

test("a tracked rally teaches its ball: the run outlives a reload, and the model that comes out is chosen", PATIENCE, async () => {
  assert.ok(await page.getByTestId("video-teach").isHidden());
  await tracked(video("rally/tennis.mp4"));
  await page.getByTestId("video-teach-steps").fill("0");
  await page.getByTestId("video-teach-start").click();
  await page.getByTestId("video-alert").filter({ hasText: "Steps per network must be a number from 1" }).waitFor(PATIENCE);
  await page.getByTestId("video-teach-steps").fill("25");
  await page.getByTestId("video-teach-name").fill("rally ball");
  await page.getByTestId("video-teach-start").click();
  await training(3);
  await page.reload();
  const again = page.getByTestId("video-teach-continue");
  await again.filter({ hasText: /^Continue from step \d+ of 75$/ }).waitFor(PATIENCE);
  const step = Number((await again.textContent()).match(/\d+/)[0]);
  await again.click();
  // It goes on where it was.
  assert.ok((await training(1)) > step);
  const said = page.getByTestId("video-teach-said");
  await said.filter({ hasText: "“rally ball” is saved" }).waitFor(PATIENCE);
  console.log(await said.textContent());
  const model = await page.evaluate(storedIn, "model rally ball");
  assert.equal(JSON.parse(model.card).name, "rally ball");
  assert.equal(await page.getByTestId("video-model").inputValue(), "kept rally ball");
  assert.ok(await again.isHidden());
});

test("a video of one flight is refused, in words", PATIENCE, async () => {
  // The rally's model finds another flight here.
  await page.getByTestId("video-model").selectOption("any");
  await tracked(video("real/toss_wall.mp4"));
  await page.getByTestId("video-teach-start").click();
  await page.getByTestId("video-alert").filter({ hasText: "usable flight" }).waitFor(PATIENCE);
  console.log(await page.getByTestId("video-alert").textContent());
});

test("axe finds nothing to complain of, and a phone shows it without scrolling sideways", PATIENCE, async () => {
  for (const width of [1280, 390]) {
    await page.setViewportSize({ width, height: 860 });
    assert.deepEqual(await axe(page, '[data-part="video-teach"]'), []);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${width} px`);
  }
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));
