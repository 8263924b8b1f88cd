/** Step Calibrate of the page, as a user meets it. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open, saved, value } from "./support/browser.js";
import { drawnCourt, pngOf } from "./support/court.js";
import { jsonFile, pictureOf, pngFile, samples } from "./support/demo.js";
import { serve } from "./support/server.js";

const { camera } = samples[0];
const PATIENCE = { timeout: 60_000 };
const complaints = [];
let server, browser, page, points;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#calibrate`, complaints);
  await page.getByTestId("cal-court").locator("option").nth(3).waitFor({ state: "attached", ...PATIENCE });
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("without a picture the step says calmly what to do", async () => {
  assert.ok(await page.getByTestId("cal-empty").isVisible());
  assert.match(await page.getByTestId("cal-hint").textContent(), /Choose a picture/);
  assert.equal(await page.getByTestId("cal-alert").textContent(), "");
  assert.ok(await page.getByTestId("cal-use").isDisabled());
});

test("the sample's points, clicked where they are, give the sample's camera", async () => {
  await page.getByTestId("cal-sample").click();
  await page.getByTestId("cal-point-9").waitFor();
  points = await projected();
  await clickAt(points[0].image);
  await clickAt(points[1].image);
  await page.getByTestId("cal-hint").filter({ hasText: "2 more points" }).waitFor();
  for (const { image } of points.slice(2)) await clickAt(image);
  await page.waitForFunction(() => document.querySelector('[data-part="cal-count"]').textContent.includes("10 of 10"));
  await settled();
  assert.ok((await value(page, "cal-rms")) < 0.3, "a mouse is this exact");
  const found = await savedJson("cal-save");
  assert.ok(Math.abs(found.intrinsic[0][0] - camera.intrinsic[0][0]) < 12, `${found.intrinsic[0][0]} px`);
  nearMatrix(found.camera_from_world, camera.camera_from_world, 0.35);
});

test("own points with exact clicks, loaded as JSON, give the camera exactly", async () => {
  await load({ width: 224, height: 224, intrinsic: camera.intrinsic, world: points.map(({ world }) => world), image: points.map(({ image }) => image), names: points.map((_, index) => `own ${index}`) });
  await settled();
  assert.ok((await value(page, "cal-rms")) < 1e-3);
  nearMatrix((await savedJson("cal-save")).camera_from_world, camera.camera_from_world, 1e-4);
  // Ten clicks without a residual leave 0.42 px of the prior's 1 px of noise.
  const sigmas = (await page.getByTestId("cal-centre-sigma").textContent()).split(" · ").map(Number);
  assert.ok(sigmas.length === 3 && sigmas.every((sigma) => sigma > 2.5 && sigma < 5), `${sigmas} cm`);
});

test("a point dragged away is named and left out, and undo brings it back", async () => {
  const box = await page.getByTestId("cal-picture").boundingBox();
  const [x, y] = onScreen(points[4].image, box);
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 40, y + 30, { steps: 4 });
  await page.mouse.up();
  await page.getByTestId("cal-outliers").filter({ hasText: "own 4" }).waitFor(PATIENCE);
  assert.match(await page.getByTestId("cal-outliers").textContent(), /Wrong click\?.*left out.*px left.*px up/);
  assert.match(await page.getByTestId("cal-state-4").textContent(), /wrong click\? left out/);
  nearMatrix((await savedJson("cal-save")).camera_from_world, camera.camera_from_world, 1e-3);
  await page.keyboard.press("Control+z");
  await page.waitForFunction(() => document.querySelector('[data-part="cal-outliers"]').textContent === "");
  await settled();
  assert.ok((await value(page, "cal-rms")) < 1e-3);
});

test("the keyboard moves a point by a pixel and by a tenth, and takes the click away", async () => {
  await page.getByTestId("cal-point-2").click();
  const before = (await savedPoints()).image[2];
  await page.getByTestId("cal-picture").focus();
  for (const key of ["ArrowRight", "ArrowRight", "Shift+ArrowDown"]) await page.keyboard.press(key);
  const [x, y] = (await savedPoints()).image[2];
  assert.ok(Math.abs(x - before[0] - 2) < 1e-3 && Math.abs(y - before[1] - 0.1) < 1e-3, `${x}, ${y} from ${before}`);
  await page.getByTestId("cal-picture").focus();
  await page.keyboard.press("Delete");
  assert.match(await page.getByTestId("cal-state-2").textContent(), /not clicked/);
  for (const key of ["Enter", "ArrowLeft", "Enter"]) await page.keyboard.press(key);
  assert.match(await page.getByTestId("cal-state-2").textContent(), /off by|clicked at|left out/);
  for (let times = 0; times < 3; times++) await page.keyboard.press("Control+z");
  await settled();
  assert.ok((await value(page, "cal-rms")) < 1e-3, "all of it is undone");
});

test("own coordinates can be written, and a missing one is told", async () => {
  await page.getByTestId("cal-add").click();
  await page.getByTestId("cal-name-10").fill("pole");
  await page.getByTestId("cal-x-10").fill("0");
  await page.getByTestId("cal-y-10").fill("0");
  await page.getByTestId("cal-z-10").fill("1.5");
  const [image] = await project([[0, 0, 1.5]]);
  await clickAt(image);
  await page.getByTestId("cal-count").filter({ hasText: "11 of 11" }).waitFor();
  await settled();
  assert.ok((await value(page, "cal-rms")) < 0.3);
  await page.getByTestId("cal-z-10").fill("");
  await page.getByTestId("cal-count").filter({ hasText: "10 of 11" }).waitFor();
  await page.getByTestId("cal-remove-10").click();
  assert.equal(await page.getByTestId("cal-point-10").count(), 0);
});

test("a reload keeps picture, points and clicks, and the camera is used", async () => {
  await settled();
  const before = await savedPoints();
  await page.reload();
  await page.getByTestId("cal-count").filter({ hasText: "10 of 10" }).waitFor(PATIENCE);
  await settled();
  assert.deepEqual(await savedPoints(), before);
  assert.ok(await page.getByTestId("cal-frame").isVisible());
  await page.getByTestId("cal-use").click();
  assert.match(await page.getByTestId("cal-said").textContent(), /other steps now use/);
  const kept = await page.evaluate(() => JSON.parse(localStorage.getItem("gravisight.camera")));
  nearMatrix(kept.camera_from_world, camera.camera_from_world, 1e-3);
});

test("Try uses the calibrated camera for a picture of its size, and asks for one for another size", async () => {
  await page.evaluate(() => (location.hash = "try"));
  await page.getByTestId("file-input").setInputFiles([pngFile("alone.png", pictureOf(samples[0]))]);
  await page.getByTestId("drop").filter({ hasText: /alone\.png · with the camera calibrated on / }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("alert").textContent(), "");
  await page.getByTestId("file-input").setInputFiles([pngFile("large.png", pngOf(drawnCourt([])))]);
  await page.getByTestId("alert").filter({ hasText: "large.png needs its camera.json" }).waitFor(PATIENCE);
  await page.evaluate(() => (location.hash = "calibrate"));
});

test("axe finds nothing to complain of, in light and in dark", async () => {
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await axe(page, "#panel-calibrate"), [], colorScheme);
  }
  await page.emulateMedia({ colorScheme: null });
});

test("a court's template lists its points, the outer corners first, and too few clicks are no alarm", async () => {
  await page.getByTestId("cal-court").selectOption("tennis");
  await page.getByTestId("cal-point-24").waitFor(PATIENCE);
  assert.match(await page.getByTestId("cal-about").textContent(), /ITF/);
  assert.match(await page.getByTestId("cal-point-0").textContent(), /left.*-5\.485, .* m/);
  assert.match(await page.getByTestId("cal-hint").textContent(), /4 more points/);
  assert.equal(await page.getByTestId("cal-alert").textContent(), "");
  const names = await page.locator(".cal-choose > span:nth-child(2)").allTextContents();
  const order = ["doubles corner", "singles corner", "service line"].flatMap((corner) => ["far", "near"].flatMap((end) => ["left", "right"].map((side) => `${end} ${corner} ${side}`)));
  assert.deepEqual(names.slice(0, 12), order);
  // Then the crossings on the court's axes; what is above the ground comes last.
  assert.deepEqual(names.slice(12, 16), ["far centre mark", "near centre mark", "far service T", "near service T"]);
  assert.deepEqual(names.slice(-3), ["net post top left", "net post top right", "net centre top"]);
  await page.getByTestId("cal-own").click();
  assert.equal(await page.getByTestId("cal-name-0").inputValue(), "far doubles corner left");
});

test("points on one line are explained by the core's own words", async () => {
  const world = [0, 1, 2, 3, 4].map((x) => [x / 4, 0, 0]);
  await load({ width: 224, height: 224, world, image: await project(world) });
  await page.getByTestId("cal-hint").filter({ hasText: "one line" }).waitFor(PATIENCE);
  assert.ok(await page.getByTestId("cal-found").isHidden());
});

test("files that are of no use are refused in words", async () => {
  for (const [file, words] of [
    [pngFile("x.png", Buffer.from("no picture")), /x\.png is not a picture/],
    [jsonFile({ width: 5 }, "p.json"), /p\.json is not a points\.json/],
    [jsonFile("{", "p.json"), /not JSON/],
    [jsonFile({ width: 5, height: 5, image: [], world: [] }, "p.json"), /5 × 5 pixels, but this one has 224 × 224/],
  ]) {
    await page.getByTestId("cal-file").setInputFiles([file]);
    await page.getByTestId("cal-alert").filter({ hasText: words }).waitFor(PATIENCE);
  }
  await page.getByTestId("cal-file").setInputFiles([{ name: "broken.mp4", mimeType: "video/mp4", buffer: Buffer.from("no video") }]);
  await page.getByTestId("cal-alert").filter({ hasText: "broken.mp4" }).waitFor(PATIENCE);
  assert.doesNotMatch(await page.getByTestId("cal-picture-name").textContent(), /reading/);
  await page.getByTestId("cal-file").setInputFiles([pngFile("good.png", pictureOf(samples[1]))]);
  await page.getByTestId("cal-picture-name").filter({ hasText: "good.png, 224 × 224" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("cal-alert").textContent(), "");
});

test("a phone shows the step without scrolling sideways", async () => {
  const phone = await open(browser, `${server.url}#calibrate`, complaints, { viewport: { width: 390, height: 844 } });
  await phone.getByTestId("cal-sample").click();
  await phone.getByTestId("cal-point-9").waitFor(PATIENCE);
  assert.ok(await phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  await phone.context().close();
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

/** Of the sample's corners: the page's own coordinates, and where the core projects them. */
async function projected() {
  const world = await page.evaluate(() => {
    const value = (name) => document.querySelector(`[data-part="${name}"]`).valueAsNumber;
    return [...Array(10).keys()].map((index) => ["x", "y", "z"].map((axis) => value(`cal-${axis}-${index}`)));
  });
  const images = await project(world);
  return world.map((place, index) => ({ world: place, image: images[index] }));
}

let harness;
async function project(world) {
  harness ??= await open(browser, `${server.url}harness.html`, complaints);
  return harness.evaluate(async ([camera, world]) => {
    const toolbox = await window.gravisight.Toolbox.create();
    const images = await toolbox.project(camera, world);
    toolbox.dispose();
    return images;
  }, [camera, world]);
}

function onScreen([u, v], box) {
  return [box.x + ((u + 0.5) / 224) * box.width, box.y + ((v + 0.5) / 224) * box.height];
}

async function clickAt(image) {
  const overlay = page.getByTestId("cal-picture");
  await overlay.scrollIntoViewIfNeeded();
  await page.mouse.click(...onScreen(image, await overlay.boundingBox()));
}

/** Waits until a camera of the present clicks is shown. */
async function settled() {
  await page.waitForFunction(
    () => {
      const states = [...document.querySelectorAll('[data-part^="cal-state-"]')].map((state) => state.textContent);
      return !document.querySelector('[data-part="cal-found"]').hidden && states.length > 0 && !states.some((state) => state.startsWith("clicked at"));
    },
    null,
    PATIENCE,
  );
}

const savedJson = async (testId) => JSON.parse(await saved(page, testId));
const savedPoints = () => savedJson("cal-save-points");

async function load(content) {
  await page.getByTestId("cal-load").setInputFiles([jsonFile(content, "points.json")]);
  await page.getByTestId("cal-count").filter({ hasText: `${content.image.length} of ${content.image.length}` }).waitFor(PATIENCE);
}

function nearMatrix(actual, expected, tolerance) {
  for (const [index, value] of expected.flat().entries()) {
    assert.ok(Math.abs(actual.flat()[index] - value) <= tolerance, `${JSON.stringify(actual)} is not ${JSON.stringify(expected)}`);
  }
}
