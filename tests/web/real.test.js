/** The real clip that comes with the page, in the step Your video; its picture is in page.test.js. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open, saved, value } from "./support/browser.js";
import { real, realLabels } from "./support/demo.js";
import { serve } from "./support/server.js";

/** The model and the clip take this long at most, on a busy machine. */
const PATIENCE = { timeout: 120_000 };
/** Of the clip, frames a second. */
const FPS = 30;
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

test("the real clip is tracked at one click: the ball is where a person labelled it, and the table says what does not belong to its flight", PATIENCE, async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  await own.getByTestId("video-real").click();
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  const words = await own.getByTestId("video-fit-words").textContent();
  // The camera is assumed, and how many frames a browser plays differs: whether one flight explains them all, or the ball is
  // in the hand in the first, is open.
  assert.match(words, /^((Explained|Not all explained): \d flights?, \d hits?|Not explained: )/);
  assert.match(await own.getByTestId("video-place").textContent(), /camera is not known.*26 mm/);
  const { frames } = JSON.parse((await saved(own, "video-json")).toString());
  const watched = await value(own, "video-processed");
  assert.ok(watched + (await value(own, "video-skipped")) >= realLabels.length - 2, `${watched} frames`);
  const off = frames.map(({ time, image }) => {
    const { image: label, radius } = realLabels[Math.round(time * FPS)];
    return distance(image, label) / radius;
  });
  assert.ok(off.filter((radii) => radii < 0.5).length >= 0.9 * watched, `${off} radii`);
  // By the ball's size and the assumed camera it is 1.7 m away.
  const depths = frames.flatMap(({ depth }) => depth ?? []);
  const [near, far] = [Math.min(...depths), Math.max(...depths)];
  const expected = (2 * real.camera.intrinsic[0][0] * real.ball.radius) / realLabels[0].radius;
  assert.ok(near > 0.8 * expected && far < 1.2 * expected, `${near} to ${far} m, by the labels ${expected} m`);
  const [header, ...rows] = (await saved(own, "video-csv")).toString().trim().split("\r\n");
  const column = header.split(",").indexOf("outlier");
  const marked = rows.filter((row) => row.split(",")[column] === "true").length;
  const [, told = "0"] = words.match(/ (\d+) sightings? do(?:es)? not belong to it/) ?? [];
  assert.equal(marked, Number(told), `${marked} of ${rows.length} frames`);
  assert.ok(marked <= 0.4 * rows.length, `${marked} of ${rows.length} frames`);
  await own.close();
});

test("a table of flights with their reasons stays within the page, wide and narrow", PATIENCE, async () => {
  const own = await open(browser, "about:blank", complaints);
  // The clip has one flight and no hit: the core's answer gets some, with one of its longer reasons.
  await own.addInitScript(hearFlights, {
    reason: "its trajectory misses what was seen by 12.3 px on average, 31 times the noise: a force is unknown, or the scene, the camera or the frame rate are wrong there",
  });
  await own.goto(`${server.url}#video`);
  await own.getByTestId("video-real").click();
  await own.getByTestId("video-flights").waitFor(PATIENCE);
  assert.equal(await own.getByTestId("video-flight").count(), 3);
  assert.match(await own.getByTestId("video-flights").textContent(), /frame rate are wrong there/);
  for (const width of [1280, 390]) {
    await own.setViewportSize({ width, height: 844 });
    // Pictures and charts follow the new width a moment later.
    await own.waitForFunction((width) => document.documentElement.scrollWidth === width, width, PATIENCE);
    const { x, width: table } = await own.getByTestId("video-flights").boundingBox();
    assert.ok(x >= 0 && x + table <= width, `the table reaches from ${x} to ${x + table} px of ${width}`);
  }
  await own.close();
});

test("nothing was reported to the console", () => assert.deepEqual(complaints, []));

function distance(a, b) {
  return Math.hypot(...a.map((coordinate, axis) => coordinate - b[axis]));
}

// Runs before the page's scripts: what Workers answer about a video gets three flights and two hits.
function hearFlights({ reason }) {
  const { addEventListener } = Worker.prototype;
  Worker.prototype.addEventListener = function (type, listener, options) {
    const heard = (event) => {
      const answer = event.data?.answer;
      if (answer?.flights && answer.hits) {
        const explained = { start: 0.1, end: 0.8, speedStart: 4.321, speedSigma: 0.021, spin: [31, -52, 12], spinSigma: [1, 2, 1], explained: true, reason: null };
        answer.flights = [explained, { ...explained, explained: false, reason }, explained];
        answer.hits = [0.3, 0.6].map((time) => ({ time, frame: 30 * time, world: [-0.123, 1.234, 0.345], explained: true }));
      }
      listener(event);
    };
    addEventListener.call(this, type, type === "message" ? heard : listener, options);
  };
}
