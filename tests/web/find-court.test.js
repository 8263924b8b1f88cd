/** A court is found without clicks: in the step Calibrate, and from the step Your video. */
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { Toolbox } from "gravisight";
import { axe, launch, open, saved } from "./support/browser.js";
import { drawnCourt, pngOf, seatedCamera, stillVideoOf } from "./support/court.js";
import { jsonFile, pngFile } from "./support/demo.js";
import { serve } from "./support/server.js";

/** A search in vain takes this long at most, on a busy machine. */
const PATIENCE = { timeout: 60_000 };
const complaints = [];
/** A court; one that lacks three lines, so that it is only probable; one that lacks two, so that several fit; ground without paint. */
const pictures = {};
let server, browser, page, video;

before(async () => {
  const toolbox = await Toolbox.create();
  const { lines } = await toolbox.court("tennis");
  const badminton = (await toolbox.court("badminton")).lines;
  toolbox.dispose();
  const court = drawnCourt(lines);
  pictures.court = pngFile("court.png", pngOf(court));
  pictures.worn = pngFile("worn.png", pngOf(drawnCourt(lines.filter((_, index) => ![2, 3, 6].includes(index)))));
  pictures.doubtful = pngFile("doubtful.png", pngOf(drawnCourt(badminton.filter((_, index) => ![4, 5].includes(index)))));
  pictures.plain = pngFile("plain.png", pngOf(drawnCourt([])));
  const file = join(mkdtempSync(join(tmpdir(), "gravisight-court-")), "court.webm");
  stillVideoOf(court, file);
  video = { name: "court.webm", mimeType: "video/webm", buffer: readFileSync(file) };
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#calibrate`, complaints);
  await page.getByTestId("cal-court").locator("option").nth(3).waitFor({ state: "attached", ...PATIENCE });
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("without a picture there is nothing to search", async () => {
  assert.ok(await page.getByTestId("cal-find").isDisabled());
});

test("of a court that nobody named, any is searched, and a sure one gives its camera", async () => {
  await page.getByTestId("cal-file").setInputFiles([pictures.court]);
  await page.getByTestId("cal-find").click();
  await said(/^Found: tennis court, 99 % probable, 9 of 9 lines\. Drag a point if a line is off\.$/);
  assert.equal(await page.getByTestId("cal-court").inputValue(), "tennis");
  await page.getByTestId("cal-lines").filter({ hasText: "Refined with 9 of the 9" }).waitFor(PATIENCE);
  assert.match(await page.getByTestId("cal-state-0").textContent(), /^off by/);
  assert.ok(await page.getByTestId("cal-find-yes").isHidden());
  isNearTruth(await savedJson("cal-save"));
});

test("the camera's uncertainty is that of the search, in the page and after points.json was saved and loaded", async () => {
  const sigma = await page.getByTestId("cal-centre-sigma").textContent();
  const points = await savedJson("cal-save-points");
  assert.ok(points.sigma_px > 1 && points.lines.length === 9, JSON.stringify(points).slice(0, 200));
  await page.getByTestId("cal-load").setInputFiles([jsonFile(points, "points.json")]);
  await page.getByTestId("cal-find-said").filter({ hasText: /^$/ }).waitFor({ state: "attached" });
  await page.getByTestId("cal-lines").filter({ hasText: "Refined with 9 of the 9" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("cal-centre-sigma").textContent(), sigma);
  await page.getByTestId("cal-undo").click();
  await said(/^Found: tennis court/);
});

test("a half-turn swaps near and far, and comes back", async () => {
  const [, y] = await centre();
  await page.getByTestId("cal-find-turn").click();
  await page.getByTestId("cal-centre").filter({ hasText: "· 29" }).waitFor(PATIENCE);
  const [x, turned] = await centre();
  assert.ok(Math.abs(turned + y) < 0.02 && x < -2.9, `${x}, ${turned} after ${y}`);
  await page.getByTestId("cal-find-turn").click();
  await page.getByTestId("cal-centre").filter({ hasText: "-29" }).waitFor(PATIENCE);
});

test("a point that is dragged a little counts as well, and the lines hold the camera", async () => {
  const box = await page.getByTestId("cal-picture").boundingBox();
  const { image } = await savedJson("cal-save-points");
  const [x, y] = [box.x + ((image[0][0] + 0.5) / 960) * box.width, box.y + ((image[0][1] + 0.5) / 540) * box.height];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 3, y, { steps: 3 });
  await page.mouse.up();
  await page.getByTestId("cal-lines").filter({ hasText: "Refined with 9 of the 9" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("cal-outliers").textContent(), "");
  isNearTruth(await savedJson("cal-save"));
});

test("undo goes back to before the search", async () => {
  await page.getByTestId("cal-undo").click();
  // The half-turns, and then the search.
  for (let times = 0; times < 3; times++) await page.getByTestId("cal-undo").click();
  assert.equal(await page.getByTestId("cal-court").inputValue(), "");
  assert.equal(await page.getByTestId("cal-find-said").textContent(), "");
  assert.ok(await page.getByTestId("cal-use").isDisabled());
});

test("a probable court is used only once a person says that it is one", async () => {
  await page.getByTestId("cal-court").selectOption("tennis");
  await page.getByTestId("cal-point-0").waitFor(PATIENCE);
  // The sport is known: it is looked for at once.
  await page.getByTestId("cal-file").setInputFiles([pictures.worn]);
  await said(/^Perhaps found: tennis court, \d\d % probable, 6 of 9 lines\. Is this the court\?$/);
  await page.getByTestId("cal-lines").filter({ hasText: /Refined with \d of the 9/ }).waitFor(PATIENCE);
  assert.ok(await page.getByTestId("cal-use").isDisabled());
  assert.match(await page.getByTestId("cal-hint").textContent(), /Answer below the picture/);
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await axe(page, "#panel-calibrate"), [], colorScheme);
  }
  await page.emulateMedia({ colorScheme: null });
  await page.getByTestId("cal-find-no").focus();
  await page.keyboard.press("Enter");
  await page.getByTestId("cal-count").filter({ hasText: "0 of" }).waitFor();
  await page.keyboard.press("Control+z");
  await said(/^Perhaps found/);
  await page.getByTestId("cal-find-yes").focus();
  await page.keyboard.press("Enter");
  await said(/^Found: tennis court/);
  await page.locator('[data-part="cal-use"]:enabled').waitFor(PATIENCE);
  isNearTruth(await savedJson("cal-save"));
});

test("of several cameras that fit, another can be chosen, and is asked about as well", async () => {
  await page.getByTestId("cal-own").click();
  await page.getByTestId("cal-file").setInputFiles([pictures.doubtful]);
  await page.getByTestId("cal-find").click();
  await said(/^Perhaps found: (?!badminton)/);
  const cameras = page.getByTestId("cal-find-camera");
  const names = await cameras.locator("option").allTextContents();
  const badminton = names.findIndex((name) => /badminton court, \d\d %/.test(name));
  assert.ok(badminton > 0, names.join());
  await cameras.selectOption(String(badminton));
  await said(/^Perhaps found: badminton court, \d\d % probable\. Is this the court\?$/);
  assert.equal(await page.getByTestId("cal-court").inputValue(), "badminton");
  assert.equal(await cameras.inputValue(), String(badminton));
  await page.getByTestId("cal-find-yes").click();
  await page.locator('[data-part="cal-use"]:enabled').waitFor(PATIENCE);
  isNearTruth(await savedJson("cal-save"));
  assert.deepEqual(await axe(page, ".calibrate .stage"), []);
  for (let times = 0; times < 2; times++) await page.getByTestId("cal-undo").click();
  await said(/^Perhaps found: (?!badminton)/);
  await cameras.selectOption(String(badminton));
  await page.getByTestId("cal-find-yes").click();
  await said(/^Found: badminton court/);
});

test("a reload keeps what was found", async () => {
  await page.reload();
  await said(/^Found: badminton court/);
  await page.locator('[data-part="cal-use"]:enabled').waitFor(PATIENCE);
});

test("a picture without a court has none, with the reason, and points can be clicked", async () => {
  await page.getByTestId("cal-court").selectOption("tennis");
  await page.getByTestId("cal-file").setInputFiles([pictures.plain]);
  await said(/^Looking for the tennis court…$/);
  await said(/^No court found: no lines in the picture form a tennis court.*\. Click points of the court instead\.$/);
  assert.equal(await page.getByTestId("cal-alert").textContent(), "");
  assert.match(await page.getByTestId("cal-hint").textContent(), /4 more points/);
});

test("a search can be stopped, and a change ends it", async () => {
  await page.getByTestId("cal-find").click();
  await page.getByTestId("cal-find").filter({ hasText: "Stop looking" }).click();
  await page.getByTestId("cal-find").filter({ hasText: "Find the court" }).waitFor();
  await page.getByTestId("cal-find").click();
  // The page answers while it searches.
  await page.getByTestId("cal-court").selectOption("football");
  await page.getByTestId("cal-find-not").waitFor({ timeout: 2000 });
  assert.ok(await page.getByTestId("cal-find").isDisabled());
  assert.equal(await page.getByTestId("cal-find-said").textContent(), "");
});

test("Your video finds its court, uses the camera and shows the lines in Calibrate", async () => {
  const own = await open(browser, `${server.url}#video`, complaints);
  await own.getByTestId("video-input").setInputFiles([video]);
  await own.getByTestId("video-find-note").filter({ hasText: "Choose the place above" }).waitFor(PATIENCE);
  assert.ok(await own.getByTestId("video-find").isHidden());
  await own.getByTestId("video-sport").selectOption("tennis");
  await own.getByTestId("video-find").click();
  await own.getByTestId("video-found-said").filter({ hasText: "Found: tennis court, 99 % probable, 9 of 9 lines. The positions are in metres." }).waitFor(PATIENCE);
  assert.ok(await own.getByTestId("video-needs-camera").isHidden());
  assert.match(await own.getByTestId("video-place").textContent(), /Camera: found from the court in the first frame of court\.webm, \d\d:\d\d, 960 × 540 px/);
  const [camera, sigma] = await own.evaluate(() => ["camera", "camera-sigma"].map((name) => JSON.parse(localStorage.getItem(`gravisight.${name}`))));
  isNearTruth(camera);
  assert.ok(sigma.length >= 7);
  assert.deepEqual(await axe(own, '[data-part="video-found"]'), []);

  await own.getByTestId("video-check").click();
  await own.getByTestId("cal-find-said").filter({ hasText: "Found: tennis court" }).waitFor(PATIENCE);
  await own.getByTestId("cal-picture-name").filter({ hasText: "the first frame of court.webm, 960 × 540" }).waitFor();
  await own.locator('[data-part="cal-use"]:enabled').filter({ hasText: "go back" }).click();
  await own.waitForFunction(() => location.hash === "#video");
  await own.context().close();
});

test("what is not sure in Your video is a question in Calibrate", async () => {
  const own = await open(browser, `${server.url}#video`, complaints, { viewport: { width: 390, height: 844 } });
  await own.getByTestId("video-sport").selectOption("tennis");
  await own.getByTestId("video-input").setInputFiles([pictures.worn]);
  await own.getByTestId("video-find").click();
  await own.getByTestId("cal-find-said").filter({ hasText: "Is this the court?" }).waitFor(PATIENCE);
  assert.ok(await own.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  await own.getByTestId("cal-find-yes").click();
  await own.locator('[data-part="cal-use"]:enabled').filter({ hasText: "go back" }).click();
  await own.waitForFunction(() => location.hash === "#video");
  await own.getByTestId("video-place").filter({ hasText: "960 × 540 px" }).waitFor(PATIENCE);
  await own.context().close();
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

const said = (words) => page.getByTestId("cal-find-said").filter({ hasText: words }).waitFor(PATIENCE);
const savedJson = async (testId) => JSON.parse(await saved(page, testId));

/** Where the camera stands, as the page says, m. */
async function centre() {
  return (await page.getByTestId("cal-centre").textContent()).split(" · ").map(Number);
}

function isNearTruth({ intrinsic, camera_from_world }) {
  assert.ok(Math.abs(intrinsic[0][0] / seatedCamera.intrinsic[0][0] - 1) < 0.005, `${intrinsic[0][0]} px`);
  const far = camera_from_world.flatMap((row, index) => row.map((value, column) => Math.abs(value - seatedCamera.camera_from_world[index][column])));
  assert.ok(Math.max(...far) < 0.1, JSON.stringify(camera_from_world));
}
