/** The CPU builds themselves, without the package around them. */
import assert from "node:assert/strict";
import { createReadStream, readFileSync } from "node:fs";
import { createServer } from "node:http";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch } from "./support/browser.js";
import { builds } from "./support/builds.js";
import { pictureOf, samples } from "./support/demo.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const TYPES = { js: "text/javascript", wasm: "application/wasm" };
let server, browser, page;

before(async () => {
  server = createServer((request, response) => {
    const { pathname } = new URL(request.url, "http://localhost");
    if (!/^\/(pkg\/wasm|models)\/[\w./-]+$/.test(pathname) || pathname.includes("..")) {
      return response.setHeader("Content-Type", "text/html").end("<!doctype html><title>kernels</title>");
    }
    response.setHeader("Content-Type", TYPES[pathname.split(".").pop()] ?? "application/octet-stream");
    createReadStream(root + pathname).on("error", () => response.destroy()).pipe(response);
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  browser = await launch({ webgpu: false });
  page = await browser.newPage();
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
});

after(async () => {
  await browser?.close();
  server?.close();
});

test("each build finds the ball at the same place, and a thousand pictures take no more memory than the first", async () => {
  const found = {};
  for (const build of ["cpu", "cpu-relaxed"].filter((each) => builds.includes(each))) {
    const { device, world, before, after } = await page.evaluate(thousandPictures, { build, camera: JSON.stringify(samples[0].camera) });
    assert.equal(after, before, `${build}: ${before} bytes after 20 pictures, ${after} after 1,020`);
    assert.match(device, build === "cpu" ? /SIMD128/ : /relaxed SIMD/);
    found[build] = world;
  }
  const [first, ...others] = Object.values(found);
  assert.equal(first.length, 3);
  for (const other of others) other.forEach((value, axis) => assert.ok(Math.abs(value - first[axis]) < 1e-3, JSON.stringify(found)));
});

test("the build alone reads every picture that a page has, leaves it as it is, and says of others that they are none", async () => {
  const given = { base64: pictureOf(samples[0]).toString("base64"), camera: JSON.stringify(samples[0].camera) };
  const { found, intact, codes, words, milliseconds } = await page.evaluate(everyPicture, given);
  for (const [kind, world] of Object.entries(found)) {
    // A stream's frames may come in a video's colours.
    const most = kind === "video" ? 0.1 : 2e-3;
    world.forEach((value, axis) => assert.ok(Math.abs(value - found.bytes[axis]) < most, `${kind}: ${world} is not ${found.bytes}`));
  }
  assert.deepEqual(intact, { bytes: true, pixels: true, bitmap: true, frame: true });
  assert.deepEqual(codes, {
    nothing: "image-read",
    text: "image-read",
    object: "image-read",
    "empty canvas": "image-read",
    "closed bitmap": "image-read",
    "broken image": "image-read",
    "a part of the pixels": "image-decode",
    "bytes that were sent away": "image-decode",
    "no picture": "image-decode",
  });
  assert.match(words, /^the picture could not be drawn to pixels: \S+/);
  assert.ok(milliseconds > 0);
});

test("it reads them in a Worker, too", async () => {
  const given = { base64: pictureOf(samples[0]).toString("base64"), camera: JSON.stringify(samples[0].camera) };
  const found = await page.evaluate(inWorker, { ...given, program: `(${readsInWorker})()` });
  assert.deepEqual(Object.keys(found), ["bytes", "blob", "pixels", "bitmap", "canvas", "frame"]);
  for (const [kind, world] of Object.entries(found)) {
    world.forEach((value, axis) => assert.ok(Math.abs(value - found.bytes[axis]) < 2e-3, `${kind}: ${world} is not ${found.bytes}`));
  }
});

test("in Node.js it reads files and pixels, and says that it cannot draw", async () => {
  const module = await import("../../pkg/wasm/cpu/gravisight.js");
  const read = (path) => readFileSync(root + path);
  await module.default({ module_or_path: read("/pkg/wasm/cpu/gravisight_bg.wasm") });
  const localiser = await module.Localiser.create(read("/models/sd-l.json").toString(), read("/models/sd-l.safetensors"), "cpu");
  assert.equal(localiser.adapter, undefined);
  const camera = JSON.stringify(samples[0].camera);
  const png = pictureOf(samples[0]);
  const { world } = await localiser.localise(png, camera);
  for (const same of [new Blob([png]), png.buffer.slice(png.byteOffset, png.byteOffset + png.length)]) {
    assert.deepEqual((await localiser.localise(same, camera)).world, world);
  }
  const { width, height } = samples[0].camera;
  const { depth } = await localiser.localise({ data: new Uint8ClampedArray(4 * width * height), width, height }, camera, { truth: [0, 0, 0] });
  assert.ok(depth > 0);
  await assert.rejects(localiser.localise({ getContext() {} }, camera), { name: "GravisightError", code: "image-read", message: /no browser here; give a PNG/ });
  localiser.free();
});

// The functions below run in the page; one of them in its Worker.

async function everyPicture({ base64, camera }) {
  const module = await import("/pkg/wasm/cpu/gravisight.js");
  await module.default();
  const bytesAt = async (path) => new Uint8Array(await (await fetch(path)).arrayBuffer());
  const localiser = await module.Localiser.create(await (await fetch("/models/sd-l.json")).text(), await bytesAt("/models/sd-l.safetensors"), "cpu");
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const blob = new Blob([bytes]);
  const bitmap = await createImageBitmap(blob);
  const { width, height } = bitmap;
  const drawnOn = (canvas) => {
    Object.assign(canvas, { width, height }).getContext("2d").drawImage(bitmap, 0, 0);
    return canvas;
  };
  const canvas = drawnOn(document.createElement("canvas"));
  const offscreen = drawnOn(new OffscreenCanvas(1, 1));
  const iframe = document.body.appendChild(document.createElement("iframe"));
  const foreign = drawnOn(iframe.contentDocument.createElement("canvas"));
  const image = new Image();
  image.src = URL.createObjectURL(blob);
  await image.decode();
  const frame = new VideoFrame(canvas, { timestamp: 0 });
  const pixels = canvas.getContext("2d").getImageData(0, 0, width, height);
  const plain = { data: new Uint8Array(pixels.data), width, height };
  const video = Object.assign(document.createElement("video"), { muted: true, srcObject: canvas.captureStream(10) });
  const playing = video.play();
  // A stream begins with the first change.
  const timer = setInterval(() => drawnOn(canvas), 50);
  await playing;
  const pictures = { bytes, buffer: bytes.buffer, blob, bitmap, canvas, offscreen, foreign, image, frame, pixels, plain, video };
  const found = {};
  let milliseconds = Infinity;
  for (const [kind, picture] of Object.entries(pictures)) {
    const position = await localiser.localise(picture, camera);
    found[kind] = position.world;
    milliseconds = Math.min(milliseconds, position.milliseconds);
  }
  clearInterval(timer);
  const intact = { bytes: bytes.length > 0, pixels: pixels.data.length > 0, bitmap: bitmap.width > 0, frame: frame.codedWidth > 0 };
  frame.close();

  const closed = await createImageBitmap(canvas);
  closed.close();
  const sent = bytes.slice();
  structuredClone(sent, { transfer: [sent.buffer] });
  const wrong = {
    nothing: undefined,
    text: "picture.png",
    object: {},
    "empty canvas": new OffscreenCanvas(0, 0),
    "closed bitmap": closed,
    "broken image": new Image(),
    "a part of the pixels": { ...plain, height: height + 1 },
    "bytes that were sent away": sent,
    "no picture": new Blob(["no picture"]),
  };
  const codes = {};
  for (const [kind, picture] of Object.entries(wrong)) codes[kind] = await localiser.localise(picture, camera).then(() => "found", ({ code }) => code);
  const words = await localiser.localise(undefined, camera).catch(({ message }) => message);
  return { found, intact, codes, words, milliseconds };
}

async function inWorker({ program, ...given }) {
  const worker = new Worker(URL.createObjectURL(new Blob([program], { type: "text/javascript" })), { type: "module" });
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => resolve(data);
    worker.onerror = ({ message }) => reject(new Error(message));
    worker.postMessage({ ...given, origin: location.origin });
  });
}

function readsInWorker() {
  self.onmessage = async ({ data: { origin, base64, camera } }) => {
    const module = await import(`${origin}/pkg/wasm/cpu/gravisight.js`);
    await module.default();
    const bytesAt = async (path) => new Uint8Array(await (await fetch(origin + path)).arrayBuffer());
    const card = await (await fetch(`${origin}/models/sd-l.json`)).text();
    const localiser = await module.Localiser.create(card, await bytesAt("/models/sd-l.safetensors"), "cpu");
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const blob = new Blob([bytes]);
    const bitmap = await createImageBitmap(blob);
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const pixels = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const pictures = { bytes, blob, pixels, bitmap, canvas, frame: new VideoFrame(canvas, { timestamp: 0 }) };
    const found = {};
    for (const [kind, picture] of Object.entries(pictures)) found[kind] = (await localiser.localise(picture, camera)).world;
    self.postMessage(found);
  };
}

async function thousandPictures({ build, camera }) {
  const module = await import(`/pkg/wasm/${build}/gravisight.js`);
  const { memory } = await module.default({ module_or_path: `/pkg/wasm/${build}/gravisight_bg.wasm` });
  const card = await (await fetch("/models/sd-l.json")).text();
  const weights = new Uint8Array(await (await fetch("/models/sd-l.safetensors")).arrayBuffer());
  const localiser = await module.Localiser.create(card, weights, "cpu");
  const data = new Uint8Array(224 * 224 * 4).map((_, index) => (index * 7919) % 251);
  const run = () => localiser.localise({ data, width: 224, height: 224 }, camera);
  let result;
  for (let picture = 0; picture < 20; picture++) result = await run();
  const before = memory.buffer.byteLength;
  for (let picture = 0; picture < 1000; picture++) result = await run();
  return { device: localiser.deviceName, world: result.world, before, after: memory.buffer.byteLength };
}
