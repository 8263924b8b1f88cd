/** The step Try beyond its samples: a ball that a person points at, what is saved, other kinds of pictures, errors in words. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open, saved } from "./support/browser.js";
import { alertOf, drop, forget, jsonFile, located, pictureOf, pngFile, press, ready, samples, shown } from "./support/demo.js";
import { serve } from "./support/server.js";

const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, server.url, complaints);
  await located(page);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

const world = (of = page) => shown(of, "world-x", "world-y", "world-z");
const distance = (a, b) => Math.hypot(...a.map((value, axis) => value - b[axis]));
const heading = (text) => page.getByTestId("result-heading").filter({ hasText: text }).waitFor();

/** Where a pixel of the sample's picture is on the screen. */
async function onScreen([u, v], { width, height } = { width: 224, height: 224 }) {
  const box = await page.getByTestId("pointing-overlay").boundingBox();
  return [box.x + ((u + 0.5) / width) * box.width, box.y + ((v + 0.5) / height) * box.height];
}

/** The radius in the picture, px, of the sample's ball: of 20 cm before a camera. */
function radiusOf({ camera, world }) {
  const [, , [a, b, c, d]] = camera.camera_from_world;
  const depth = a * world[0] + b * world[1] + c * world[2] + d;
  return (0.2 * camera.intrinsic[0][0]) / depth;
}

test("a circle around the ball gives its position at once, by pointer and by keys, and says so", async () => {
  await press(page, 0);
  const found = await world();
  await page.getByTestId("circle").click();
  await page.getByTestId("pointing-overlay").waitFor();
  const { image } = samples[0];
  const radius = radiusOf(samples[0]);
  const [from, to] = [await onScreen(image), await onScreen([image[0] + radius, image[1]])];
  await page.mouse.move(...from);
  await page.mouse.down();
  await page.mouse.move(...to, { steps: 4 });
  await page.mouse.up();
  await heading("from your circle");
  await page.waitForFunction((x) => Number(document.querySelector('[data-part="world-x"]').value) !== x, found[0]);
  const drawn = await world();
  const [sigma] = await shown(page, "sigma");
  const off = distance(drawn, samples[0].world);
  console.log(`by a circle: ${(100 * off).toFixed(0)} cm off, sigma ${(100 * sigma).toFixed(0)} cm`);
  assert.ok(off < 3 * sigma && sigma > 0.02, `${off} m off, σ ${sigma} m`);
  // A circle that is 20 % smaller is of a ball that is 25 % farther away.
  const [depth] = await shown(page, "depth");
  const smaller = Math.round(0.2 * radius);
  for (let key = 0; key < smaller; key++) await page.keyboard.press("-");
  await page.waitForFunction((depth) => Number(document.querySelector('[data-part="depth"]').value) > depth, depth * 1.05);
  const [, v] = await shown(page, "image-xy");
  await page.keyboard.press("Shift+ArrowDown");
  await page.waitForFunction((v) => Number(document.querySelector('[data-part="image-xy"]').value.split(" ")[1]) > v + 9, v);
  assert.deepEqual(await axe(page, "#panel-try"), []);
  await page.keyboard.press("Escape");
  await heading("Position in the world");
  assert.deepEqual(await world(), found, "the network's position is back");
});

test("a circle needs no model", async () => {
  const lost = await open(browser, `${server.url}?model=models/none.json`, complaints);
  await lost.waitForFunction(() => document.querySelector('[data-part="alert"]').textContent !== "");
  // The first sample is shown: it would take the place of what is dropped before.
  await lost.getByTestId("circle").waitFor();
  await drop(lost, pngFile("own.png", pictureOf(samples[0])), jsonFile(samples[0].camera));
  await lost.getByTestId("drop").filter({ hasText: "own.png" }).waitFor();
  await lost.getByTestId("circle").click();
  await lost.getByTestId("pointing-overlay").waitFor();
  await lost.keyboard.press("+");
  await lost.waitForFunction(() => document.querySelector('[data-part="world-x"]').value !== "");
  await lost.close();
});

test("the likeliest places are offered, and one that is chosen gives its position", async () => {
  await press(page, 1);
  const found = await world();
  const places = page.getByTestId("places").locator("button");
  const count = await places.count();
  assert.ok(count >= 2 && count <= 5, `${count} places`);
  await page.getByTestId("place-2").click();
  await heading("Position that you chose");
  assert.notDeepEqual(await world(), found);
  assert.match(await page.getByTestId("depth").textContent(), /±/);
  assert.equal(await page.getByTestId("place-2").getAttribute("aria-pressed"), "true");
  await page.getByTestId("place-1").click();
  assert.ok(distance(await world(), found) < 1e-9, "the first one is what was found");
});

test("a search in a box looks nowhere else, and the whole picture can be searched again", async () => {
  await press(page, 0);
  const found = await world();
  const { image } = samples[0];
  const corner = image.map((at) => (at > 112 ? 10 : 214));
  await page.getByTestId("box").click();
  await page.getByTestId("pointing-overlay").waitFor();
  const [from, to] = [await onScreen(corner), await onScreen(corner.map((at) => (at > 112 ? at - 60 : at + 60)))];
  await page.mouse.move(...from);
  await page.mouse.down();
  await page.mouse.move(...to, { steps: 4 });
  await forget(page);
  await page.mouse.up();
  await located(page);
  const [u, v] = await shown(page, "image-xy");
  assert.ok(Math.abs(u - corner[0]) < 70 && Math.abs(v - corner[1]) < 70, `${u}, ${v} is in the box`);
  await forget(page);
  await page.getByTestId("box").filter({ hasText: "whole picture" }).click();
  await located(page);
  assert.deepEqual(await world(), found);
});

test("where no ball is found the page says so above the numbers", async () => {
  const grey = await page.evaluate(() => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 224;
    const context = canvas.getContext("2d");
    context.fillStyle = "#888";
    context.fillRect(0, 0, 224, 224);
    return canvas.toDataURL("image/png").split(",")[1];
  });
  await forget(page);
  await drop(page, pngFile("grey.png", Buffer.from(grey, "base64")), jsonFile(samples[0].camera));
  await located(page);
  const words = page.getByTestId("no-ball");
  assert.match(await words.textContent(), /^No ball found\. Circle the ball/);
  assert.ok((await words.boundingBox()).y < (await page.getByTestId("world-x").boundingBox()).y);
  await press(page, 0);
  assert.ok(await words.isHidden());
});

test("numbers of the last picture do not stay while the next one is worked on", async () => {
  await press(page, 0);
  await page.evaluate(() => {
    const place = document.querySelector('[data-part="world-x"]');
    window.texts = [];
    new MutationObserver(() => window.texts.push(place.textContent)).observe(place, { childList: true, characterData: true, subtree: true });
  });
  await press(page, 1);
  const texts = await page.evaluate(() => window.texts);
  assert.equal(texts[0], "–");
});

test("the numbers are copied, and saved as JSON and as a picture with the ring", async () => {
  await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await press(page, 2);
  const expected = await world();
  await page.getByTestId("copy").click();
  await page.getByTestId("saved").filter({ hasText: "Copied" }).waitFor();
  const text = await page.evaluate(() => navigator.clipboard.readText());
  assert.match(text, new RegExp(`x, m\\t${expected[0].toFixed(4)}`));
  assert.match(text, /Found by\tthe network/);
  const json = JSON.parse((await saved(page, "save-json")).toString());
  assert.deepEqual(json.world, expected);
  assert.equal(json.found_by, "the network");
  assert.equal(json.ball.radius, 0.2);
  assert.equal(json.camera.width, 224);
  const png = await saved(page, "save-picture");
  // At the picture's own size.
  assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20)], [224, 224]);
  assert.notDeepEqual(png, pictureOf(samples[2]));
});

test("the sample that was chosen last is shown after a reload", async () => {
  await press(page, 4);
  await page.reload();
  await located(page);
  assert.equal(await page.getByTestId("sample-4").getAttribute("aria-pressed"), "true");
});

test("a sample's ball is known, and the diameter of an own one is asked for in centimetres", async () => {
  await press(page, 0);
  assert.ok(await page.getByTestId("ball").isDisabled());
  assert.match(await page.getByTestId("ball-why").textContent(), /This sample’s ball is known: 40\.0 cm/);
  await drop(page, pngFile("own.png", pictureOf(samples[0])), jsonFile(samples[0].camera));
  await page.waitForFunction(() => !document.querySelector('[data-part="ball"]').disabled);
  for (const wrong of ["-3", "5000", ""]) {
    await page.getByTestId("ball").fill(wrong);
    await page.getByTestId("ball").dispatchEvent("change");
    const words = await alertOf(page);
    assert.match(words, /diameter must be between 0 and 200 centimetres/);
    assert.doesNotMatch(words, /radius/);
  }
  await forget(page);
  await page.getByTestId("ball").fill("40");
  await page.getByTestId("ball").dispatchEvent("change");
  await located(page);
});

test("a picture of a kind that only the browser reads is localised, too", async () => {
  await press(page, 2);
  const expected = await world();
  const pixels = await page.evaluate(async (base64) => {
    const image = await createImageBitmap(new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], { type: "image/png" }));
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext("2d");
    context.drawImage(image, 0, 0);
    return [...context.getImageData(0, 0, image.width, image.height).data];
  }, pictureOf(samples[2]).toString("base64"));
  await forget(page);
  await drop(page, { name: "own.bmp", mimeType: "image/bmp", buffer: bmp(pixels, 224, 224) }, jsonFile(samples[2].camera));
  await page.getByTestId("ball").fill("40");
  await page.getByTestId("ball").dispatchEvent("change");
  await located(page);
  await ready(page);
  assert.ok(distance(await world(), expected) < 1e-6, `${await world()} is not ${expected}`);
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});

/** A BMP file of RGBA pixels. */
function bmp(rgba, width, height) {
  const row = Math.ceil((3 * width) / 4) * 4;
  const file = Buffer.alloc(54 + row * height);
  file.write("BM");
  file.writeUInt32LE(file.length, 2);
  file.writeUInt32LE(54, 10);
  file.writeUInt32LE(40, 14);
  file.writeInt32LE(width, 18);
  file.writeInt32LE(-height, 22);
  file.writeUInt16LE(1, 26);
  file.writeUInt16LE(24, 28);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      const [r, g, b] = rgba.slice(4 * (y * width + x));
      file.set([b, g, r], 54 + y * row + 3 * x);
    }
  }
  return file;
}
