/** Step Calibrate: the court's drawing, points that the picture does not show, and what is said while a camera is computed. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { Toolbox } from "gravisight";
import { axe, launch, open } from "./support/browser.js";
import { drawnCourt, pngOf, seatedCamera } from "./support/court.js";
import { pngFile } from "./support/demo.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 60_000 };
const complaints = [];
/** Of the drawn tennis court: where the camera sees each point. */
const images = new Map();
let server, browser, page, picture, court;

before(async () => {
  const toolbox = await Toolbox.create();
  court = await toolbox.court("tennis");
  const names = Object.keys(court.points);
  for (const [index, at] of (await toolbox.project(seatedCamera, Object.values(court.points))).entries()) images.set(names[index], at);
  toolbox.dispose();
  picture = pngFile("court.png", pngOf(drawnCourt(court.lines)));
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await opened(browser);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("the court is drawn from above with its lines and its points, the corners at its corners", async () => {
  assert.equal(await page.locator(".court-line").count(), court.lines.length);
  assert.equal(await page.locator(".court-point").count(), Object.keys(court.points).length);
  const [farLeft, farRight, nearLeft] = await centresOf("far doubles corner left", "far doubles corner right", "near doubles corner left");
  assert.ok(farLeft[0] < farRight[0] - 100 && Math.abs(farLeft[1] - farRight[1]) < 1, "left and right");
  assert.ok(nearLeft[1] > farLeft[1] + 100 && Math.abs(nearLeft[0] - farLeft[0]) < 1, "the far end is at the top");
  // A raised point stands beside its foot and has another shape.
  const [foot, top] = await centresOf("net post foot left", "net post top left");
  assert.ok(Math.hypot(foot[0] - top[0], foot[1] - top[1]) > 10 && top[1] < foot[1]);
  assert.equal(await page.locator(".court-point[data-raised]").count(), 3);
  assert.ok((await page.getByTestId("cal-map-0").getAttribute("class")).includes("current"));
});

test("a click on a dot chooses its point, and the next click in the picture places it and lights the following one", async () => {
  const service = await indexOf("near service T");
  await page.getByTestId(`cal-map-${service}`).click();
  await page.getByTestId("cal-next").filter({ hasText: "near service T" }).waitFor();
  assert.equal(await pressed(), service);
  await clickAt(images.get("near service T"));
  assert.equal(await stateOf("near service T"), "clicked");
  assert.equal(await pressed(), service + 1);
  assert.match(await page.getByTestId(`cal-map-${service}`).getAttribute("aria-label"), /near service T, clicked$/);
  await page.getByTestId("cal-undo").click();
  assert.equal(await stateOf("near service T"), "open");
});

test("the keyboard goes over the court and chooses a point; one dot is in the tab order", async () => {
  const from = await indexOf("far doubles corner left");
  await page.getByTestId(`cal-map-${from}`).focus();
  assert.equal(await page.locator('.court-point[tabindex="0"]').count(), 1);
  for (const key of ["ArrowDown", "ArrowRight", "Enter"]) await page.keyboard.press(key);
  const chosen = await page.locator(".court-point:focus").getAttribute("aria-label");
  assert.match(chosen, /singles line at the net left|near|far/);
  assert.equal(await page.locator(".court-point:focus").getAttribute("aria-pressed"), "true");
  assert.equal(await page.locator('.court-point[tabindex="0"]').count(), 1);
  await page.keyboard.press("Home");
  await page.keyboard.press(" ");
  assert.equal(await pressed(), 0);
});

test("a point that is not in the picture is crossed out, passed over, kept and taken back", async () => {
  await page.getByTestId("cal-absent").click();
  assert.equal(await stateOf("far doubles corner left"), "absent");
  assert.equal(await page.getByTestId("cal-state-0").textContent(), "not in the picture");
  assert.equal(await pressed(), 1);
  await page.getByTestId("cal-picture").focus();
  await page.keyboard.press("n");
  assert.equal(await stateOf("far doubles corner right"), "absent");
  await page.keyboard.press("Control+z");
  assert.equal(await stateOf("far doubles corner right"), "open");
  await page.reload();
  await page.getByTestId("cal-map-24").waitFor(PATIENCE);
  assert.equal(await stateOf("far doubles corner left"), "absent");
  assert.equal(await pressed(), 1);
  await page.getByTestId("cal-map-0").click();
  await page.getByTestId("cal-absent").filter({ hasText: "It is in the picture" }).click();
  assert.equal(await stateOf("far doubles corner left"), "open");
});

test("while the camera is computed the page says so at once, and no longer asks for points", async () => {
  await page.evaluate(() => {
    window.said = [];
    for (const part of ["cal-hint", "cal-progress-text"]) {
      const place = document.querySelector(`[data-part="${part}"]`);
      new MutationObserver(() => window.said.push(`${part}: ${place.textContent}`)).observe(place, { childList: true, characterData: true, subtree: true });
    }
  });
  const names = ["far service line left", "far service line right", "near service line left", "near service line right"];
  const place = async (name) => {
    await page.getByTestId(`cal-map-${await indexOf(name)}`).click();
    await clickAt(images.get(name));
  };
  for (const name of names.slice(0, 3)) await place(name);
  assert.equal(await page.getByTestId("cal-progress-text").textContent(), "1 more point to click.");
  await place(names[3]);
  await page.getByTestId("cal-progress-text").filter({ hasText: /^Camera found: \d\.\d\d pixels/ }).waitFor(PATIENCE);
  const said = await page.evaluate(() => window.said);
  const computing = said.indexOf("cal-progress-text: Computing the camera…");
  assert.ok(computing > 0 && said.includes("cal-hint: Computing the camera…"), said.join("\n"));
  assert.ok(!said.slice(computing).some((text) => /more points? to click/.test(text)), said.join("\n"));
});

test("axe finds nothing in the filled step, in light and in dark", async () => {
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await axe(page, "#panel-calibrate"), [], colorScheme);
  }
  await page.emulateMedia({ colorScheme: null });
});

test("own points have no court to draw, and every court is drawn with its points apart", async () => {
  for (const name of await page.getByTestId("cal-court").locator("option").evaluateAll((options) => options.map(({ value }) => value).filter(Boolean))) {
    await page.getByTestId("cal-court").selectOption(name);
    await page.waitForFunction(() => {
      const texts = (place) => [...document.querySelectorAll(place)].map(({ textContent }) => textContent);
      const [dots, points] = [texts(".court-point title"), texts(".cal-choose > span:nth-child(2)")];
      return dots.length === points.length && dots.every((text, index) => text.includes(points[index]));
    }, null, PATIENCE);
    const outside = await page.evaluate(() => {
      const { left, right, top, bottom } = document.querySelector(".court-map").getBoundingClientRect();
      return [...document.querySelectorAll(".court-dot")].map((dot) => dot.getBoundingClientRect()).filter((box) => box.left < left || box.right > right || box.top < top || box.bottom > bottom).length;
    });
    assert.equal(outside, 0, name);
    const closest = await page.locator(".court-dot").evaluateAll((dots) => {
      const places = dots.map((dot) => dot.getBBox()).map(({ x, y, width, height }) => [x + width / 2, y + height / 2]);
      return Math.min(...places.flatMap(([x, y], index) => places.slice(index + 1).map((other) => Math.hypot(other[0] - x, other[1] - y))));
    });
    assert.ok(closest > 12, `${name}: ${closest}`);
  }
  await page.getByTestId("cal-own").click();
  assert.ok(await page.getByTestId("cal-map-card").isHidden());
});

test("on a phone the drawing follows the picture, and the camera comes after the points", async () => {
  const phone = await opened(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  const tops = await Promise.all([".stage", ".cal-map-card", ".cal-points", ".cal-result"].map(async (place) => (await phone.locator(`.calibrate ${place}`).boundingBox()).y));
  assert.deepEqual(tops, tops.toSorted((a, b) => a - b));
  assert.ok(await phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  // Closer to its neighbours than a finger is broad: the nearest counts.
  const [x, y] = await centreOf("net post foot left", phone);
  await phone.touchscreen.tap(x + 2, y + 8);
  await phone.getByTestId("cal-next").filter({ hasText: "net post foot left" }).waitFor();
  await phone.context().close();
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

/** The step with a picture of a tennis court, whose points are not clicked. */
async function opened(browser, options = {}) {
  const own = await open(browser, `${server.url}#calibrate`, complaints, options);
  await own.getByTestId("cal-court").locator("option").nth(3).waitFor({ state: "attached", ...PATIENCE });
  await own.getByTestId("cal-file").setInputFiles([picture]);
  await own.getByTestId("cal-picture-name").filter({ hasText: "court.png" }).waitFor(PATIENCE);
  await own.getByTestId("cal-court").selectOption("tennis");
  await own.getByTestId("cal-map-24").waitFor(PATIENCE);
  return own;
}

async function indexOf(name, own = page) {
  const names = await own.locator(".cal-choose > span:nth-child(2)").allTextContents();
  assert.ok(names.includes(name), name);
  return names.indexOf(name);
}

async function centreOf(name, own = page) {
  const dot = own.getByTestId(`cal-map-${await indexOf(name, own)}`).locator(".court-dot");
  await dot.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await dot.boundingBox();
  return [x + width / 2, y + height / 2];
}

/** Of several dots at one moment: the page may still be moving. */
async function centresOf(...names) {
  const parts = await Promise.all(names.map(async (name) => `cal-map-${await indexOf(name)}`));
  return page.evaluate((parts) => {
    const boxes = parts.map((part) => document.querySelector(`[data-part="${part}"] .court-dot`).getBoundingClientRect());
    return boxes.map(({ x, y, width, height }) => [x + width / 2, y + height / 2]);
  }, parts);
}

const stateOf = async (name) => page.getByTestId(`cal-map-${await indexOf(name)}`).getAttribute("data-state");

/** The point whose dot is lit. */
const pressed = () => page.locator(".court-point").evaluateAll((dots) => dots.findIndex((dot) => dot.getAttribute("aria-pressed") === "true"));

async function clickAt([u, v]) {
  const overlay = page.getByTestId("cal-picture");
  await overlay.scrollIntoViewIfNeeded();
  const box = await overlay.boundingBox();
  await page.mouse.click(box.x + ((u + 0.5) / seatedCamera.width) * box.width, box.y + ((v + 0.5) / seatedCamera.height) * box.height);
}
