/** The package itself, in a page that offers it as `window.gravisight`. */
import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { pictureOf, samples } from "./support/demo.js";
import { abortARun } from "./support/in-page.js";
import { serve } from "./support/server.js";

const CARD = "models/sd-l.json";
const modelFile = (name) => readFileSync(new URL(`../../models/${name}`, import.meta.url));
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch();
  page = await harness();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("create reports bytes and warming up, and a picture in any shape gives one position", async () => {
  const { stages, worlds, timestamps, detached } = await page.evaluate(inEveryShape, {
    model: CARD,
    camera: samples[2].camera,
    base64: pictureOf(samples[2]).toString("base64"),
  });
  assert.ok(stages.some((each) => each.stage === "wasm" && each.loaded > 0));
  assert.ok(stages.some((each) => each.stage === "weights" && each.loaded === each.total));
  assert.equal(stages.at(-1).stage, "warming up");
  for (const [shape, world] of Object.entries(worlds)) {
    world.forEach((value, axis) => assert.ok(Math.abs(value - worlds.bytes[axis]) < 0.02, `${shape}: ${world} is not ${worlds.bytes}`));
  }
  assert.deepEqual(timestamps, [40, "timestamp-order", 40]);
  assert.equal(detached, false, "the caller keeps its buffer");
});

test("the page keeps ticking while pictures are localised", async () => {
  // Were the work done on the page's own thread, no timer could fire while a picture is in flight.
  const ticks = await page.evaluate(countTicks, { model: CARD, camera: samples[2].camera, base64: pictureOf(samples[2]).toString("base64") });
  assert.equal(ticks.length, 5);
  assert.ok(ticks.every((count) => count > 0), `ticks during each picture: ${ticks}`);
});

test("an abort while loading rejects with the signal's reason", async () => {
  const reason = await page.evaluate(async (model) => {
    const controller = new AbortController();
    const mine = new Error("mine");
    const creating = window.gravisight.Localiser.create({ model, signal: controller.signal, onProgress: () => controller.abort(mine) });
    return creating.then(() => "created", (thrown) => thrown === mine);
  }, CARD);
  assert.equal(reason, true);
});

test("an aborted run rejects with the signal's reason, and the next one is served", async () => {
  const outcome = await page.evaluate(abortARun, { model: CARD, camera: samples[2].camera, base64: pictureOf(samples[2]).toString("base64") });
  assert.deepEqual(outcome, { aborted: [true, true, true], served: 3 });
});

test("after dispose every call rejects with code disposed", async () => {
  const codes = await page.evaluate(async ({ model, camera }) => {
    const localiser = await window.gravisight.Localiser.create({ model });
    const picture = new ImageData(camera.width, camera.height);
    const running = localiser.localise(picture, { camera }).catch((thrown) => thrown.code);
    await new Promise((resolve) => setTimeout(resolve));
    localiser.dispose();
    return [await running, await localiser.localise(picture, { camera }).catch((thrown) => thrown.code)];
  }, { model: CARD, camera: samples[2].camera });
  assert.deepEqual(codes, ["disposed", "disposed"]);
});

test("a camera that holds NaN is refused by name", async () => {
  const thrown = await page.evaluate(async ({ model, camera }) => {
    const localiser = await window.gravisight.Localiser.create({ model });
    camera.width = NaN;
    const { name, code, message } = await localiser.localise(new ImageData(8, 8), { camera }).catch((each) => each);
    localiser.dispose();
    return { name, code, message };
  }, { model: CARD, camera: samples[2].camera });
  assert.equal(thrown.name, "GravisightError");
  assert.equal(thrown.code, "camera-not-finite");
  assert.match(thrown.message, /width/);
});

test("what is no camera, and no device, is refused, and the localiser goes on", async () => {
  const { codes, found } = await page.evaluate(async ({ model, camera }) => {
    const { Localiser } = window.gravisight;
    const codes = [await Localiser.create({ model, device: "gpu" }).catch((each) => each.code)];
    const localiser = await Localiser.create({ model });
    const picture = new ImageData(224, 224);
    const circular = { ...camera };
    circular.self = circular;
    for (const wrong of [undefined, () => {}, 3, circular]) {
      codes.push(await localiser.localise(picture, { camera: wrong }).catch((each) => each.code));
    }
    // As a framework hands it over.
    const truth = new Proxy([0, 0, 0], {});
    const found = await localiser.localise(picture, { camera, truth });
    localiser.dispose();
    return { codes, found };
  }, { model: CARD, camera: samples[0].camera });
  assert.deepEqual(codes, ["device", "camera-missing", "camera-format", "camera-format", "camera-format"]);
  assert.ok(found.dtg > 0);
});

test("weights that are not the card's are refused", async () => {
  const weights = Buffer.from(modelFile("sd-l.safetensors"));
  weights[weights.length - 1] ^= 1;
  assert.equal((await createWith({ weights })).code, "weights-sha256");
});

test("truncated weights are refused", async () => {
  const weights = modelFile("sd-l.safetensors");
  assert.match((await createWith({ weights: weights.subarray(0, weights.length / 2) })).code, /^weights-/);
});

test("weights that hold NaN are refused, even where the card knows their sha256", async () => {
  const { weights, card } = withNaN(modelFile("sd-l.safetensors"), modelFile("sd-l.json").toString());
  const thrown = await createWith({ weights, card });
  assert.match(thrown.code, /^weights-/);
  assert.notEqual(thrown.code, "weights-sha256");
});

test("a card that is not JSON is refused", async () => {
  assert.equal((await createWith({ card: "{" })).code, "card-json");
});

test("a failed fetch names the URL and the status", async () => {
  // The browser itself reports the 404 to the console; this page's complaints are not counted.
  const other = await harness([]);
  await other.route("**/*.safetensors", (route) => route.fulfill({ status: 404, body: "" }));
  const thrown = await other.evaluate(create, CARD);
  assert.equal(thrown.code, "fetch");
  assert.match(thrown.message, /sd-l\.safetensors.*404/);
  await other.close();
});

test("kept weights that were damaged are fetched again, and those that no card names any more are dropped", async () => {
  const other = await harness();
  const [card, weights] = [modelFile("sd-l.json").toString(), modelFile("sd-l.safetensors")];
  let fetched = 0;
  await other.route("**/*.safetensors", (route) => (fetched++, route.fulfill({ contentType: "application/octet-stream", body: weights })));
  const load = async () => assert.equal((await other.evaluate(create, CARD)).message, "created");
  await other.evaluate(() => window.gravisight.clearCache());
  await load();
  await load();
  assert.equal(fetched, 1, "the second time they are kept");
  const { sha256 } = JSON.parse(card);
  await other.evaluate(keepAs, { name: sha256, text: "damaged" });
  await load();
  assert.equal(fetched, 2);
  await load();
  assert.equal(fetched, 2, "in place of the damaged ones");

  // What an earlier version of a model left behind, and of this package; and cards that were loaded long ago.
  for (const name of ["0".repeat(64), 'times ["0.0.0-old"]']) await other.evaluate(keepAs, { name, text: "old" });
  for (let number = 0; number < 9; number++) await other.evaluate(keepAs, { name: `card https://example.invalid/${number}.json`, text: "{}" });
  await load();
  const kept = await other.evaluate(keptNames);
  assert.equal(kept.filter((name) => name.startsWith("card ")).length, 8, `${kept}`);
  assert.ok(kept.includes(sha256) && kept.some((name) => name.endsWith(CARD)), `${kept}`);
  assert.ok(!kept.includes("0".repeat(64)) && !kept.some((name) => name.includes("0.0.0-old")), `${kept}`);

  // A server that sends something else does not take the card's place.
  await other.route(`**/${CARD}`, (route) => route.fulfill({ contentType: "application/json", body: "{" }));
  assert.equal((await other.evaluate(create, CARD)).code, "card-json");
  await other.unroute(`**/${CARD}`);
  await other.route(`**/${CARD}`, (route) => route.abort());
  await load();
  await other.close();
  // The browser's own report of the last one.
  complaints.splice(0, complaints.length, ...complaints.filter((complaint) => !complaint.includes(CARD)));
});

test("a start page in place of the weights is refused", async () => {
  const other = await harness();
  await other.route("**/*.safetensors", (route) => route.fulfill({ contentType: "text/html", body: "<!doctype html>" }));
  assert.equal((await other.evaluate(create, CARD)).code, "fetch");
  await other.close();
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});

function harness(keep = complaints) {
  return open(browser, `${server.url}harness.html`, keep);
}

/** What `create` throws where the server gives these instead of the model's files. */
async function createWith({ card, weights }) {
  const other = await harness();
  if (card !== undefined) await other.route(`**/${CARD}`, (route) => route.fulfill({ contentType: "application/json", body: card }));
  if (weights) await other.route("**/*.safetensors", (route) => route.fulfill({ contentType: "application/octet-stream", body: weights }));
  const thrown = await other.evaluate(create, CARD);
  await other.close();
  assert.equal(thrown.name, "GravisightError");
  return thrown;
}

/** Sets one weight to NaN (in 16 and in 32 bits) and corrects the card's sha256. */
function withNaN(original, card) {
  const weights = Buffer.from(original);
  const firstTensor = 8 + Number(weights.readBigUInt64LE(0));
  weights.writeUInt32LE(0x7fc00000, firstTensor);
  const sha256 = (bytes) => createHash("sha256").update(bytes).digest("hex");
  return { weights, card: card.replace(sha256(original), sha256(weights)) };
}

// The functions below run in the page.

async function create(model) {
  try {
    await window.gravisight.Localiser.create({ model });
    return { name: "none", code: "none", message: "created" };
  } catch ({ name, code, message }) {
    return { name, code, message };
  }
}

/** Keeps a text as the package keeps its files. */
async function keepAs({ name, text }) {
  const cache = await caches.open("gravisight");
  await cache.put(`https://gravisight.invalid/${encodeURIComponent(name)}`, new Response(text));
}

async function keptNames() {
  const keys = await (await caches.open("gravisight")).keys();
  return keys.map(({ url }) => decodeURIComponent(new URL(url).pathname.slice(1)));
}

async function inEveryShape({ model, camera, base64 }) {
  const stages = [];
  const localiser = await window.gravisight.Localiser.create({ model, onProgress: (progress) => stages.push(progress) });
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const blob = new Blob([bytes], { type: "image/png" });
  const bitmap = await createImageBitmap(blob);
  const canvas = document.createElement("canvas");
  canvas.width = bitmap.width;
  canvas.height = bitmap.height;
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  const image = new Image();
  image.src = URL.createObjectURL(blob);
  await image.decode();
  const frame = new VideoFrame(canvas, { timestamp: 0 });
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const shapes = { bytes, buffer: bytes.buffer, blob, bitmap, canvas, image, frame, pixels };
  const worlds = {};
  for (const [shape, picture] of Object.entries(shapes)) worlds[shape] = (await localiser.localise(picture, { camera })).world;
  const timestamps = [
    (await localiser.localiseVideoFrame(frame, 40, { camera })).timestampMs,
    await localiser.localiseVideoFrame(frame, 40, { camera }).catch((thrown) => thrown.code),
  ];
  localiser.startVideo();
  timestamps.push((await localiser.localiseVideoFrame(frame, 40, { camera })).timestampMs);
  frame.close();
  localiser.dispose();
  return { stages, worlds, timestamps, detached: bytes.byteLength === 0 || pixels.data.byteLength === 0 };
}

async function countTicks({ model, camera, base64 }) {
  const localiser = await window.gravisight.Localiser.create({ model });
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const ticks = [];
  for (let picture = 0; picture < 5; picture++) {
    let count = 0;
    const timer = setInterval(() => count++, 1);
    await localiser.localise(bytes, { camera, heatmap: true, depthMap: true });
    clearInterval(timer);
    ticks.push(count);
  }
  localiser.dispose();
  return ticks;
}
