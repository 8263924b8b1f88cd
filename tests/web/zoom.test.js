/** Pictures that are clicked in can be enlarged and moved: clicks, marks and magnifier stay right. In Calibrate; and buttons that move a point. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open, saved } from "./support/browser.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 60_000 };
const SIDE = 224;
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await opened();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("plus, minus and nought enlarge the picture and show it whole again; so do the buttons", async () => {
  await page.getByTestId("cal-picture").focus();
  for (const key of ["+", "+"]) await page.keyboard.press(key);
  assert.equal(await scale(), 2.25);
  await page.keyboard.press("-");
  assert.equal(await scale(), 1.5);
  await page.keyboard.press("0");
  assert.equal(await scale(), 1);
  assert.equal(await page.getByTestId("cal-picture-zoom-out").getAttribute("aria-disabled"), "true");
  await page.getByTestId("cal-picture-zoom-in").click();
  assert.equal(await scale(), 1.5);
  await page.getByTestId("cal-picture-zoom-all").click();
  assert.equal(await scale(), 1);
});

test("the wheel scrolls the page until the picture has the focus, then enlarges about the pointer", async () => {
  await page.mouse.move(...(await onScreen([60, 150])));
  await page.evaluate(() => document.activeElement.blur());
  const scrolled = await page.evaluate(() => scrollY);
  await page.mouse.wheel(0, -50);
  await page.waitForFunction((before) => scrollY < before, scrolled);
  assert.equal(await scale(), 1);
  await page.getByTestId("cal-picture").focus();
  const [x, y] = await onScreen([60, 150]);
  await page.mouse.move(x, y);
  for (let notch = 0; notch < 5; notch++) await page.mouse.wheel(0, -100);
  await page.waitForFunction(() => parseInt(document.querySelector('[data-part="cal-picture-zoom"]').textContent) > 250);
  // What was under the pointer is under it still.
  await page.mouse.click(x, y);
  await near(0, [60, 150], 0.5);
});

test("a click beside it in the enlarged picture is nearer by the scale, and has its mark there", async () => {
  const [x, y] = await onScreen([60, 150]);
  const { width } = await page.getByTestId("cal-picture").boundingBox();
  const by = (40 / width) * (SIDE / (await scale()));
  await page.mouse.click(x + 40, y - 40);
  await near(1, [60 + by, 150 - by], 0.6);
  assert.ok((await marked([x + 40, y - 40])) > 20, "a mark");
  assert.ok((await marked([x - 40, y + 40])) === 0, "none elsewhere");
  // The magnifier shows where the pointer is.
  const shown = (await page.locator(".calibrate .loupe span").textContent()).split(", ").map(Number);
  assert.ok(Math.abs(shown[0] - 60 - by) < 0.6 && Math.abs(shown[1] - 150 + by) < 0.6, `${shown}`);
});

test("a mark is dragged by as many pixels as are shown", async () => {
  const [x, y] = await onScreen([60, 150]);
  const { width } = await page.getByTestId("cal-picture").boundingBox();
  const [before] = await clicks();
  await page.mouse.move(x + 4, y);
  await page.mouse.down();
  await page.mouse.move(x + 34, y, { steps: 3 });
  await page.mouse.up();
  await near(0, [before[0] + (30 / width) * (SIDE / (await scale())), before[1]], 0.2);
  assert.equal((await clicks()).length, 2, "none was placed");
});

test("the middle button moves the picture, and so does dragging while Move is on; no point is placed", async () => {
  const [x, y] = await onScreen([112, 112]);
  const corner = () => page.locator(".calibrate .picture-zoomed").evaluate((picture) => picture.getBoundingClientRect().left);
  const from = await corner();
  await page.mouse.move(x, y);
  await page.mouse.down({ button: "middle" });
  await page.mouse.move(x - 30, y, { steps: 3 });
  await page.mouse.up({ button: "middle" });
  assert.ok(Math.abs((await corner()) - from + 30) < 1, `${await corner()} from ${from}`);
  await page.getByTestId("cal-picture-zoom-move").click();
  await page.mouse.move(...(await onScreen([112, 112])));
  await page.mouse.down();
  await page.mouse.move(x + 20, y, { steps: 3 });
  await page.mouse.up();
  assert.ok((await corner()) > from - 30 + 10);
  assert.equal((await clicks()).length, 2);
  await page.getByTestId("cal-picture-zoom-move").click();
});

test("a point that is chosen in the list comes into sight", async () => {
  await page.getByTestId("cal-picture").focus();
  for (let times = 0; times < 8; times++) await page.keyboard.press("+");
  for (const index of [0, 1]) {
    await page.getByTestId(`cal-point-${index}`).click();
    const [x, y] = (await clicks())[index];
    const box = await page.getByTestId("cal-picture").boundingBox();
    const shown = await page.locator(".calibrate .picture-zoomed").evaluate((picture) => picture.getBoundingClientRect().toJSON());
    const at = [shown.x + ((x + 0.5) / SIDE) * shown.width, shown.y + ((y + 0.5) / SIDE) * shown.height];
    assert.ok(at[0] > box.x && at[0] < box.x + box.width && at[1] > box.y && at[1] < box.y + box.height, `${at}`);
    assert.ok((await marked(at)) > 20);
  }
  await page.getByTestId("cal-picture").focus();
  await page.keyboard.press("0");
});

test("with Shift the cross crosses the picture in few steps, and a point moves by a tenth", async () => {
  await page.getByTestId("cal-point-2").click();
  await page.getByTestId("cal-picture").focus();
  await page.keyboard.press("ArrowRight");
  for (let times = 0; times < 5; times++) await page.keyboard.press("Shift+ArrowLeft");
  await page.keyboard.press("Enter");
  // From the middle, 111.5: one to the right, then a 32nd of the width each.
  await near(2, [112.5 - 35, 111.5], 1e-6);
  await page.getByTestId("cal-point-2").click();
  await page.getByTestId("cal-picture").focus();
  await page.keyboard.press("Shift+ArrowUp");
  await near(2, [77.5, 111.4], 1e-6);
});

test("the buttons move the point by one pixel or by a quarter, and repeat while they are held", async () => {
  assert.ok(await page.getByTestId("cal-left").isHidden(), "a mouse has keys beside it");
  await page.locator('[data-part="cal-nudge"] summary').click();
  await page.getByTestId("cal-right").click();
  await near(2, [78.5, 111.4], 1e-6);
  await page.getByTestId("cal-step-fine").check({ force: true });
  await page.getByTestId("cal-up").click();
  await near(2, [78.5, 111.15], 1e-6);
  await page.getByTestId("cal-down").focus();
  await page.keyboard.press("Enter");
  await near(2, [78.5, 111.4], 1e-6);
  await page.getByTestId("cal-left").hover();
  await page.mouse.down();
  await page.waitForTimeout(900);
  await page.mouse.up();
  const [, , [x]] = await clicks();
  assert.ok(x <= 78.5 - 4 * 0.25, `${x}`);
  await page.waitForTimeout(200);
  assert.equal((await clicks())[2][0], x, "it has ended");
  assert.deepEqual(await axe(page, ".calibrate .stage"), []);
});

test("two fingers enlarge and move the picture and place no point; one finger places one", async () => {
  const phone = await opened({ viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  assert.ok(await phone.getByTestId("cal-left").isVisible(), "fingers have no arrow keys");
  const overlay = phone.getByTestId("cal-picture");
  await overlay.scrollIntoViewIfNeeded();
  const box = await overlay.boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  const touch = await phone.context().newCDPSession(phone);
  const send = (type, ...places) => touch.send("Input.dispatchTouchEvent", { type, touchPoints: places.map(([dx, dy], id) => ({ id, x: x + dx, y: y + dy })) });
  // The first finger lies long enough to press: that is taken back.
  await send("touchStart", [-20, 0]);
  await phone.getByTestId("cal-count").filter({ hasText: "1 of 10" }).waitFor();
  await send("touchStart", [-20, 0], [20, 0]);
  await phone.getByTestId("cal-count").filter({ hasText: "0 of 10" }).waitFor();
  for (const far of [30, 40, 50, 60]) await send("touchMove", [-far, 0], [far, 0]);
  await send("touchEnd");
  assert.ok(Math.abs((await scale(phone)) - 3) < 0.1, `${await scale(phone)}`);
  assert.match(await phone.getByTestId("cal-count").textContent(), /0 of 10/);
  assert.match(await phone.getByTestId("cal-next").textContent(), /1\. yellow box/);
  await phone.touchscreen.tap(x, y);
  await phone.getByTestId("cal-count").filter({ hasText: "1 of 10" }).waitFor();
  const [[u, v]] = await clicks(phone);
  assert.ok(Math.abs(u - 111.5) < 1 && Math.abs(v - 111.5) < 1, `${u}, ${v}`);
  assert.ok(await phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  await phone.context().close();
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

/** The step with the sample picture and its points. */
async function opened(options = {}) {
  const own = await open(browser, `${server.url}#calibrate`, complaints, options);
  await own.getByTestId("cal-sample").click();
  await own.getByTestId("cal-point-9").waitFor(PATIENCE);
  return own;
}

/** How much the picture is enlarged. */
async function scale(own = page) {
  return own.locator(".calibrate .picture-zoomed").evaluate((picture) => Math.round((100 * picture.getBoundingClientRect().width) / picture.parentElement.getBoundingClientRect().width) / 100);
}

/** Where a pixel is while the picture is shown whole. */
async function onScreen([u, v]) {
  const overlay = page.getByTestId("cal-picture");
  await overlay.scrollIntoViewIfNeeded();
  const box = await overlay.boundingBox();
  return [box.x + ((u + 0.5) / SIDE) * box.width, box.y + ((v + 0.5) / SIDE) * box.height];
}

/** What is clicked so far, by the file that the page saves; the page does not stay scrolled to its button. */
async function clicks(own = page) {
  const top = await own.evaluate(() => scrollY);
  const { image } = JSON.parse(await saved(own, "cal-save-points"));
  await own.evaluate((top) => scrollTo(0, top), top);
  return image;
}

async function near(index, expected, tolerance) {
  const at = (await clicks())[index];
  assert.ok(at && at.every((value, axis) => Math.abs(value - expected[axis]) <= tolerance), `${at} is not ${expected}`);
}

/** How many pixels around a place of the screen have marks. */
function marked([x, y]) {
  return page.getByTestId("cal-picture").evaluate(
    (overlay, [x, y]) => {
      const box = overlay.getBoundingClientRect();
      const density = overlay.width / box.width;
      const { data } = overlay.getContext("2d").getImageData((x - box.left - 10) * density, (y - box.top - 10) * density, 20 * density, 20 * density);
      return data.filter((value, index) => index % 4 === 3 && value > 200).length;
    },
    [x, y],
  );
}
