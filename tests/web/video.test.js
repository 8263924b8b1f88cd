/** The step Your picture or video: an example, a video file, the webcam, wrong files, what is saved. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { chromium } from "playwright-core";
import { axe, launch, open, saved, SD_L, value } from "./support/browser.js";
import { jsonFile, ONE_PIXEL, pictureOf, pngFile, press, samples, shown as shownOn } from "./support/demo.js";
import { film } from "./support/film.js";
import { drawThrow } from "./support/in-page.js";
import { serve } from "./support/server.js";

/** The first frame of a model takes this long at most, on a busy machine. */
const PATIENCE = { timeout: 120_000 };
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await step();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("without a camera the step says how to get one", async () => {
  assert.match(await page.getByTestId("video-empty").innerText(), /Calibrate.*camera\.json/s);
  await page.getByTestId("video-input").setInputFiles([pngFile("ball.png", pictureOf(samples[0]))]);
  await page.getByTestId("video-needs-camera").waitFor();
  assert.match(await page.getByTestId("video-needs-camera").innerText(), /calibrated camera.*Calibrate/s);
  assert.equal(await value(page, "video-processed"), 0);
});

test("a picture and its camera.json give the position that the step Try gives", async () => {
  await page.getByTestId("video-input").setInputFiles([jsonFile(samples[0].camera)]);
  // How large the ball is nobody has said.
  await page.getByTestId("video-needs-ball").waitFor();
  assert.equal(await value(page, "video-processed"), 0);
  assert.match(await page.getByTestId("video-place").textContent(), /Place and ball: not chosen/);
  await page.getByTestId("video-sport").selectOption("floor");
  await page.getByTestId("video-ball").fill("40");
  await page.getByTestId("video-ball").dispatchEvent("change");
  await page.getByTestId("video-place").filter({ hasText: "40.0 cm across" }).waitFor();
  await count(page, 1);
  const shown = [await value(page, "video-x"), await value(page, "video-y"), await value(page, "video-z")];
  const tried = await open(browser, server.url, complaints);
  await press(tried, 0);
  const expected = await shownOn(tried, "world-x", "world-y", "world-z");
  await tried.close();
  assert.ok(distance(shown, expected) < 1e-3, `${shown} is not ${expected}`);
  assert.match(await page.getByTestId("video-place").textContent(), /camera\.json, 224 × 224 px/);
  assert.ok(await page.getByTestId("video-transport").isHidden(), "a picture is not played");
  assert.ok(await page.getByTestId("video-track").isDisabled());
  assert.match(await page.getByTestId("video-track-why").textContent(), /A single picture cannot be tracked/);
});

const refusals = {
  "a text file": [[{ name: "notes.txt", mimeType: "text/plain", buffer: Buffer.from("no video at all") }], /notes\.txt is not a video/],
  "a text file named as a video": [[{ name: "a.mp4", mimeType: "video/mp4", buffer: Buffer.from("no video at all") }], /a\.mp4 is not a video/],
  "another tool's camera": [[{ name: "cam0.yaml", mimeType: "application/yaml", buffer: Buffer.from("%YAML:1.0\ncamera_matrix: !!opencv-matrix\n") }], /cam0\.yaml: this page reads camera\.json.*gravisight camera import "cam0\.yaml" --to camera\.json/],
  "an empty file": [[{ name: "a.webm", mimeType: "video/webm", buffer: Buffer.alloc(0) }], /a\.webm is empty/],
  "a text file named as a picture": [[pngFile("x.png", Buffer.from("no picture"))], /x\.png is not a picture/],
  "two pictures": [[pngFile("a.png", ONE_PIXEL), pngFile("b.png", ONE_PIXEL)], /One video or picture at a time/],
  "a JSON file of something else": [[jsonFile({ hello: 1 }, "other.json")], /neither a camera\.json .* nor a scene\.json/],
  "broken JSON": [[jsonFile("{", "broken.json")], /broken\.json is not JSON/],
  "a camera that is none": [[jsonFile({ ...samples[0].camera, intrinsic: [[0, 0, 0], [0, 0, 0], [0, 0, 0]] })], /\w+ \w+ \w+/],
};
for (const [what, [files, words]] of Object.entries(refusals)) {
  test(`${what} is refused in words`, async () => {
    await page.getByTestId("video-input").setInputFiles(files);
    const alert = page.getByTestId("video-alert").filter({ hasText: /\w/ });
    await alert.waitFor(PATIENCE);
    assert.match(await alert.innerText(), words);
    assert.doesNotMatch(await alert.innerText(), /undefined|\[object|panicked/);
  });
}

test("the example is played, and its positions are near the truth", async () => {
  await playExample(page);
  const { frames, threshold } = await exported(page);
  const sure = frames.filter(({ confidence }) => confidence >= threshold);
  assert.ok(sure.length >= 15, `${sure.length} frames`);
  const off = sure.map(({ world, truth }) => distance(world, truth));
  const mean = average(off);
  assert.ok(mean < 0.15, `off by ${mean} m on average`);
  assert.ok(Math.abs((await value(page, "video-mean-error")) - mean) < 1e-3, "the page shows that mean");
  assert.equal(await value(page, "video-processed"), frames.length);
  assert.ok((await value(page, "video-ms")) > 0);
});

test("what was skipped is filled in by stepping, forward and back", async () => {
  await page.getByTestId("video-time").evaluate((slider) => {
    slider.value = "0";
    slider.dispatchEvent(new Event("input"));
  });
  await page.waitForFunction(() => document.querySelector('[data-part="video-clock"]').textContent === "0.00 s");
  const clock = () => page.getByTestId("video-clock").textContent();
  await page.getByTestId("video-forward").click();
  await page.getByTestId("video-forward").click();
  const second = await clock();
  assert.notEqual(second, "0.00 s");
  await page.getByTestId("video-back").click();
  assert.ok(parseFloat(await clock()) < parseFloat(second));
  await page.getByTestId("video-back").click();
  assert.equal(await clock(), "0.00 s");
});

test("heatmap, depth and what the depth depends on are drawn over the frame, by a model that reads sizes and by one that knows its scenes", PATIENCE, async () => {
  const layersOf = async (own, layers) => {
    const drawn = new Set();
    for (const layer of layers) {
      await own.getByTestId(`video-layer-${layer}`).check({ force: true });
      if (layer !== "none") await own.getByTestId("video-scale").filter({ hasText: { heatmap: "Probability", depth: /^\s*Depth\s*\d/, saliency: "Depth changes" }[layer] }).waitFor(PATIENCE);
      await own.waitForTimeout(300);
      drawn.add(await own.getByTestId("video-overlay").evaluate((canvas) => canvas.toDataURL()));
    }
    await own.getByTestId("video-layer-none").check({ force: true });
    return drawn.size;
  };
  assert.equal(await layersOf(page, ["none", "heatmap", "depth", "saliency"]), 4);
  const own = await step({}, browser, SD_L);
  await own.getByTestId("video-input").setInputFiles([pngFile("ball.png", pictureOf(samples[0])), jsonFile(samples[0].camera)]);
  await own.getByTestId("video-sport").selectOption("floor");
  await count(own, 1);
  assert.equal(await layersOf(own, ["none", "heatmap", "depth", "saliency"]), 4);
  await own.close();
});

test("physics explains the example, to within centimetres", async () => {
  await page.getByTestId("video-fit").click();
  await page.getByTestId("video-fit-words").waitFor(PATIENCE);
  assert.match(await page.getByTestId("video-fit-words").textContent(), /^The flight is explained, with \d+ bounces?; the trajectory misses the labels by .*px \(rms\)\.$/);
  const { frames, fit } = await exported(page);
  assert.ok(fit.explained);
  assert.ok(fit.impacts.length >= 1);
  assert.equal(await page.getByTestId("video-bounce").count(), fit.impacts.length);
  // Of each the place from above, with its ellipse, and its numbers.
  assert.equal(await page.getByTestId("video-plan").locator("ellipse").count(), fit.impacts.length);
  assert.match(await page.getByTestId("video-plan").locator("svg").getAttribute("aria-label"), /bounce 1 at x .* metres/);
  assert.ok((await page.getByTestId("video-contacts").locator("strong").count()) >= 1, "a place that is known to centimetres is bold");
  const truth = new Map(frames.map((frame) => [Math.round(frame.time * 1e4), frame.truth]));
  const off = fit.frames.map(({ time, world }) => distance(world, truth.get(Math.round(time * 1e4))));
  assert.ok(average(off) < 0.05, `off by ${average(off)} m on average`);
  assert.ok(await page.getByTestId("video-chart-speed").isVisible());
  assert.match(await page.getByTestId("video-chart-position").getAttribute("aria-label"), /Position \(m\).*x from .*y from .*z from .*marked at/);
});

test("a plot is drawn anew in the colours of the dark", async () => {
  const drawn = () => page.getByTestId("video-chart-position").locator("canvas").evaluate((canvas) => canvas.toDataURL());
  const light = await drawn();
  await page.emulateMedia({ colorScheme: "dark" });
  await page.waitForTimeout(200);
  assert.notEqual(await drawn(), light);
  await page.emulateMedia({ colorScheme: null });
  await page.waitForTimeout(200);
  assert.equal(await drawn(), light);
});

test("the table has a header and a row a frame; the plot is saved as a picture", async () => {
  const csv = (await saved(page, "video-csv")).toString();
  const [header, ...rows] = csv.trim().split("\r\n");
  assert.match(header, /^time_s,u_px,v_px,depth_m,x_m,y_m,z_m,confidence,fit_x_m.*speed_m_s/);
  assert.equal(rows.length, await value(page, "video-processed"));
  for (const row of rows) assert.equal(row.split(",").length, header.split(",").length);
  assert.ok(rows.every((row) => row.split(",").slice(0, 13).every((cell) => cell !== "" && Number.isFinite(Number(cell)))));
  const png = await saved(page, "video-png");
  assert.equal(png.subarray(1, 4).toString(), "PNG");
  assert.ok(png.length > 5000, `${png.length} bytes`);
});

test("the step keeps its state while another one is open", async () => {
  const before = await value(page, "video-processed");
  await page.evaluate(() => (location.hash = "try"));
  await page.getByTestId("video-step").waitFor({ state: "hidden" });
  await page.evaluate(() => (location.hash = "video"));
  await page.getByTestId("video-step").waitFor();
  assert.equal(await value(page, "video-processed"), before);
  assert.ok(await page.getByTestId("video-fit-words").isVisible());
});

test("the view in space turns by keyboard", async (context) => {
  const view = page.getByTestId("video-view");
  if (await page.getByTestId("no-webgl").count()) return context.skip("this browser has no WebGL");
  assert.match(await view.getAttribute("aria-label"), /true path.*positions.*fitted path/);
  const before = await view.screenshot();
  await view.focus();
  for (let times = 0; times < 5; times++) await page.keyboard.press("ArrowRight");
  await page.keyboard.press("+");
  await page.waitForTimeout(200);
  assert.notDeepEqual(await view.screenshot(), before);
});

test("closing ends the localiser and keeps the positions", async () => {
  const before = page.workers().length;
  await page.getByTestId("video-stop").click();
  await page.getByTestId("video-transport").waitFor({ state: "hidden" });
  assert.ok(page.workers().length < before, "its Worker has ended");
  assert.ok((await value(page, "video-processed")) > 0);
  assert.ok(await page.getByTestId("video-csv").isEnabled());
});

test("a video is played, and its positions are near the truth", PATIENCE, async () => {
  const { made, file } = await filmed();
  const own = await step();
  await own.getByTestId("video-input").setInputFiles([file, jsonFile(made.camera), jsonFile(made.scene, "scene.json")]);
  await count(own, 1);
  assert.equal(await own.getByTestId("video-alert").textContent(), "");
  await played(own, () => own.getByTestId("video-play").click());
  const { frames, threshold } = await exported(own);
  assert.ok(frames.length >= 8, `${frames.length} frames`);
  const sure = frames.filter(({ confidence }) => confidence >= threshold);
  const off = sure.map(({ time, world }) => distance(world, made.path[Math.round(time * made.fps)]));
  assert.ok(sure.length >= 0.7 * frames.length, `${sure.length} of ${frames.length} frames are sure`);
  assert.ok(average(off) < 0.15, `off by ${average(off)} m on average`);
  const times = frames.map(({ time }) => time);
  assert.deepEqual(times, times.toSorted((a, b) => a - b));
  await own.getByTestId("video-time").evaluate((slider) => {
    slider.value = String(slider.max / 2);
    slider.dispatchEvent(new Event("input"));
  });
  await own.waitForFunction(() => /^[^0]|0\.[1-9]/.test(document.querySelector('[data-part="video-clock"]').textContent));
  await own.close();
});

test("a video is tracked, corrected by a click, and its flight is near the truth", PATIENCE, async () => {
  const { made, file } = await filmed();
  const own = await step();
  await own.getByTestId("video-input").setInputFiles([file, jsonFile(made.camera), jsonFile(made.scene, "scene.json")]);
  await count(own, 1);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  assert.match(await own.getByTestId("video-fit-words").textContent(), /^The flight is explained, with \d+ bounces?; the ball was found in \d+ of \d+ frames\.$/);
  const { frames, fit } = await exported(own);
  const watched = await value(own, "video-processed");
  assert.equal(watched, made.path.length, "every frame was looked at");
  assert.equal(await value(own, "video-skipped"), 0);
  const off = frames.filter(({ world }) => world).map(({ time, world }) => distance(world, made.path[Math.round(time * made.fps)]));
  assert.ok(off.length >= 0.7 * watched, `${off.length} of ${watched} frames have a position`);
  assert.ok(average(off) < 0.1, `off by ${average(off)} m on average`);
  assert.ok(frames.every(({ sigma, world }) => (sigma === null) === (world === null)));
  assert.ok(fit.impacts.length >= 1);
  assert.match(await own.getByTestId("video-track-why").textContent(), /Click the ball there/);
  // A click on a ball that was found changes nothing but the time it takes.
  const [u, v] = frames[5].image;
  await own.getByTestId("video-time").evaluate((slider, t) => {
    slider.value = String(1000 * t);
    slider.dispatchEvent(new Event("input"));
  }, frames[5].time + 0.001);
  await own.locator('[data-part="video-overlay"][aria-label^="Found"]').waitFor(PATIENCE);
  const { width, height } = await own.getByTestId("video-overlay").boundingBox();
  await own.getByTestId("video-overlay").click({ position: { x: ((u + 0.5) / (2 * made.camera.width)) * width, y: ((v + 0.5) / (2 * made.camera.height)) * height } });
  await own.getByTestId("video-job").waitFor({ state: "hidden" });
  await own.getByTestId("video-fit-words").filter({ hasText: "is explained" }).waitFor(PATIENCE);
  assert.equal(await own.getByTestId("video-alert").textContent(), "");
  assert.ok((await exported(own)).frames.length >= frames.length - 2);
  await own.close();
});

test("a browser without a decoder plays the video to track it", PATIENCE, async () => {
  const { made, file } = await filmed();
  const own = await step();
  await own.evaluate(() => delete window.VideoDecoder);
  await own.getByTestId("video-input").setInputFiles([file]);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").filter({ hasText: "The ball was found in" }).waitFor(PATIENCE);
  const watched = await value(own, "video-processed");
  // On a busy computer some are left out, and counted.
  assert.ok(watched >= made.path.length / 3, `${watched} frames`);
  assert.ok(watched + (await value(own, "video-skipped")) >= made.path.length - 3);
  await own.close();
});

test("of a video that was cut off, or that is broken from a frame on, what comes before is tracked; it is told in words", PATIENCE, async () => {
  const { file, spoilt } = await filmed(31);
  const own = await step();
  await own.getByTestId("video-input").setInputFiles([{ ...file, buffer: file.buffer.subarray(0, 0.7 * file.buffer.length) }]);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").filter({ hasText: /The ball was found in [1-9]\d* of [1-9]\d* frames/ }).waitFor(PATIENCE);
  // Asked for at once: it is the new video that is tracked, not the one before.
  await own.getByTestId("video-input").setInputFiles([spoilt]);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-alert").filter({ hasText: /The video is broken after \d/ }).waitFor(PATIENCE);
  assert.equal(await value(own, "video-processed"), 31);
  await own.close();
});

/** The clip that {@link drawThrow} draws, and a film of it, not of the size that its camera.json speaks of; if a frame `broken` is named, also one in which that is noise. */
async function filmed(broken) {
  const filming = await open(browser, `${server.url}harness.html`, complaints);
  const made = await filming.evaluate(drawThrow);
  const [width, height] = [2 * made.camera.width, 2 * made.camera.height];
  const file = { name: "clip.webm", mimeType: "video/webm", buffer: await film(filming, { ...made, width, height }) };
  const spoilt = broken && { ...file, name: "spoilt.webm", buffer: await film(filming, { ...made, width, height, spoilt: broken }) };
  await filming.close();
  return { made, file, spoilt };
}

test("without a camera the ball is tracked in pixels, with a table to take along and how to get metres", PATIENCE, async () => {
  const { made, file } = await filmed();
  const own = await step();
  await own.getByTestId("video-input").setInputFiles([file]);
  await own.getByTestId("video-needs-camera").waitFor(PATIENCE);
  assert.match(await own.getByTestId("video-track-why").textContent(), /In pixels, because its camera is not known; with it, in metres/);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  assert.match(await own.getByTestId("video-fit-words").textContent(), /^The ball was found in \d+ of \d+ frames\.$/);
  assert.match(await own.getByTestId("video-flat").textContent(), /in pixels.*calibrate.*camera\.json.*track again/);
  const [header, ...rows] = (await saved(own, "video-csv")).toString().trim().split("\r\n");
  const column = (row, name) => row.split(",")[header.split(",").indexOf(name)];
  assert.ok(rows.length >= 0.7 * (await value(own, "video-processed")), `${rows.length} rows`);
  assert.ok(rows.every((row) => Number(column(row, "u_px")) > 0 && Number(column(row, "confidence")) > 0 && column(row, "x_m") === ""));
  await own.locator('[data-part="video-overlay"][aria-label*="the ball at pixel"]').waitFor(PATIENCE);
  assert.ok((await own.getByTestId("video-confidence").textContent()).includes("%"));
  assert.match(await own.getByTestId("video-chart-pixels").getAttribute("aria-label"), /In the picture \(px\)/);
  for (const width of [1280, 390]) {
    await own.setViewportSize({ width, height: 844 });
    await own.waitForFunction((width) => document.documentElement.scrollWidth === width, width, PATIENCE);
  }
  assert.deepEqual(await axe(own, "#panel-video"), []);
  // With the camera and the place the same video gives metres.
  await own.getByTestId("video-input").setInputFiles([jsonFile(made.camera), jsonFile(made.scene, "scene.json")]);
  await own.getByTestId("video-stale").waitFor(PATIENCE);
  assert.ok(await own.getByTestId("video-verdict").isVisible(), "what was found in pixels stays until then");
  await own.getByTestId("video-retrack").click();
  await own.getByTestId("video-fit-words").filter({ hasText: "The flight is explained" }).waitFor(PATIENCE);
  await own.close();
});

test("of a flight that is not explained no number is shown, and the reason is folded away", PATIENCE, async () => {
  const { made, file } = await filmed();
  const own = await step();
  // No ball falls so slowly.
  const moon = { ...made.scene, gravity: [0, 0, -1.62] };
  await own.getByTestId("video-input").setInputFiles([file, jsonFile(made.camera), jsonFile(moon, "scene.json")]);
  await count(own, 1);
  await own.getByTestId("video-track").click();
  await own.getByTestId("video-fit-words").waitFor(PATIENCE);
  assert.match(await own.getByTestId("video-fit-words").textContent(), /explained: no positions in metres; the ball was found in \d+ of \d+ frames\.$/);
  const reasons = own.getByTestId("video-reasons");
  assert.ok(!(await reasons.evaluate((details) => details.open)));
  assert.match(await reasons.textContent(), /(Frames 0 to \d+.*no trajectory.*explains the track|labels jump by|px from the trajectory|labels lie far from).*\.$/s);
  assert.equal(await own.getByTestId("video-flight").count(), 0);
  assert.equal(await own.getByTestId("video-x").textContent(), "–");
  assert.ok(await own.getByTestId("video-sigma-row").isHidden());
  assert.equal(await own.getByTestId("video-plan").count(), 0);
  await own.close();
});

test("a webcam starts and stops", PATIENCE, async () => {
  const args = ["--no-sandbox", "--disable-quic", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"];
  const withWebcam = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", headless: true, args });
  try {
    const own = await step({}, withWebcam);
    const camera = { ...samples[0].camera, width: 640, height: 480, intrinsic: [[600, 0, 320], [0, 600, 240], [0, 0, 1]] };
    await own.getByTestId("video-sport").selectOption("tennis");
    await own.getByTestId("video-input").setInputFiles([jsonFile(camera)]);
    await own.getByTestId("video-place").filter({ hasText: "640 × 480" }).waitFor(PATIENCE);
    await own.getByTestId("video-webcam").click();
    await count(own, 3);
    assert.ok(await own.getByTestId("video-time").isHidden(), "there is no timeline");
    const stream = await own.evaluateHandle(() => document.querySelector('[data-part="video-frame"] video').srcObject);
    assert.equal(await stream.evaluate((given) => given.getVideoTracks()[0].readyState), "live");
    assert.equal(await own.getByTestId("video-stop").textContent(), "Stop the webcam");
    // What is recorded opens as a video, which can be tracked.
    await own.getByTestId("video-record").click();
    await own.waitForTimeout(1500);
    await own.getByTestId("video-record").filter({ hasText: "Stop and open" }).click();
    await own.getByTestId("video-time").waitFor(PATIENCE);
    assert.ok(await own.getByTestId("video-track").isEnabled());
    assert.equal(await stream.evaluate((given) => given.getVideoTracks()[0].readyState), "ended");
    await own.getByTestId("video-webcam").click();
    await own.getByTestId("video-stop").filter({ hasText: "Stop the webcam" }).waitFor(PATIENCE);
    await own.getByTestId("video-stop").click();
    assert.equal(await stream.evaluate((given) => given.getVideoTracks()[0].readyState), "ended");
    // The count follows at its own pace.
    await own.waitForTimeout(500);
    const seen = await value(own, "video-processed");
    await own.waitForTimeout(500);
    assert.equal(await value(own, "video-processed"), seen, "no frame came after");
  } finally {
    await withWebcam.close();
  }
});

test("without WebGL the step says so and does the rest", PATIENCE, async () => {
  const args = ["--no-sandbox", "--disable-quic", "--disable-3d-apis"];
  const plain = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", headless: true, args });
  try {
    const own = await step({}, plain);
    await own.getByTestId("video-example").click();
    await count(own, 5);
    assert.match(await own.getByTestId("no-webgl").innerText(), /not support 3D graphics/);
  } finally {
    await plain.close();
  }
});

test("a webcam that is refused is said in words", async () => {
  // Whether a headless browser refuses by itself is the browser's matter.
  await page.evaluate(() => {
    navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException("Permission denied", "NotAllowedError"));
  });
  await page.getByTestId("video-webcam").click();
  await page.getByTestId("video-alert").filter({ hasText: /refused.*Allow it/ }).waitFor(PATIENCE);
});

test("a model that is not there is said in words", async () => {
  const lost = await step({}, browser, "?model=models/none.json");
  await lost.getByTestId("video-example").click();
  await lost.getByTestId("video-alert").filter({ hasText: /models\/none\.json/ }).waitFor(PATIENCE);
  await lost.close();
});

test("a long job can be cancelled", async () => {
  const fresh = await step();
  await fresh.getByTestId("video-example").click();
  await fresh.getByTestId("video-cancel").click();
  await fresh.getByTestId("video-job").waitFor({ state: "hidden" });
  assert.equal(await fresh.getByTestId("video-alert").textContent(), "");
  await playExample(fresh);
  await fresh.close();
});

test("the step never scrolls sideways on a phone", async () => {
  const phone = await step({ viewport: { width: 390, height: 844 } });
  const fits = () => phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth);
  assert.ok(await fits());
  await playExample(phone);
  assert.ok(await fits());
  await phone.close();
});

for (const colorScheme of ["light", "dark"]) {
  test(`axe finds nothing to complain of (${colorScheme})`, async () => {
    const seen = await step({ colorScheme });
    assert.deepEqual(await axe(seen, "#panel-video"), []);
    await playExample(seen);
    await seen.getByTestId("video-fit").click();
    await seen.getByTestId("video-fit-words").waitFor(PATIENCE);
    assert.deepEqual(await axe(seen, "#panel-video"), []);
    await seen.close();
  });
}

test("a picture dropped anywhere on the page is this step's, not the step Try's", async () => {
  const own = await step();
  const base64 = pictureOf(samples[0]).toString("base64");
  await own.evaluate(({ base64, camera, scene }) => {
    const transfer = new DataTransfer();
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    transfer.items.add(new File([bytes], "dropped.png", { type: "image/png" }));
    transfer.items.add(new File([JSON.stringify(camera)], "camera.json", { type: "application/json" }));
    transfer.items.add(new File([JSON.stringify(scene)], "scene.json", { type: "application/json" }));
    document.querySelector("footer").dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  }, { base64, camera: samples[0].camera, scene: { gravity: [0, 0, -9.81], ball: { radius: 0.2 } } });
  await count(own, 1);
  assert.equal(await own.locator("#drop-state").textContent(), "or choose the two files");
  await own.close();
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});

async function step(options, from = browser, query = "") {
  const opened = await open(from, `${server.url}${query}#video`, complaints, options);
  await opened.getByTestId("video-example").waitFor(PATIENCE);
  return opened;
}

function playExample(on) {
  return played(on, async () => {
    await on.getByTestId("video-rate").evaluate((select) => {
      select.value = "0.5";
      select.dispatchEvent(new Event("change"));
    });
    await on.getByTestId("video-example").click();
  });
}

/** Waits until what `start` starts has played to its end. */
async function played(on, start) {
  await start();
  await on.locator('[data-part="video-play"][data-playing="true"]').waitFor(PATIENCE);
  await on.locator('[data-part="video-play"][data-playing="false"]').waitFor(PATIENCE);
  // The plots follow at their own pace.
  await on.waitForTimeout(500);
}

async function count(on, atLeast) {
  await on.waitForFunction((n) => Number(document.querySelector('[data-part="video-processed"]').value) >= n, atLeast, PATIENCE);
}

async function exported(on) {
  return JSON.parse((await saved(on, "video-json")).toString());
}

function distance(a, b) {
  return Math.hypot(...a.map((coordinate, axis) => coordinate - b[axis]));
}

function average(values) {
  return values.reduce((sum, each) => sum + each, 0) / values.length;
}
