/** The package's Toolbox, Track and FineTuner, its cache and its memory, in a page that offers it as `window.gravisight`. */
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { gravisight } from "./support/command.js";
import { samples } from "./support/demo.js";
import { serve } from "./support/server.js";

const CARD = "models/sd-l.json";
const complaints = [];
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await harness();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

function harness(keep = complaints) {
  return open(browser, `${server.url}harness.html`, keep);
}

test("clicks on a court give its camera back", async () => {
  const { centre, rms, outliers, courts, refused } = await page.evaluate(async (camera) => {
    const toolbox = await window.gravisight.Toolbox.create();
    const courts = await toolbox.courts();
    const { points } = await toolbox.court("table-tennis").catch(() => toolbox.court("tennis"));
    const names = Object.keys(points);
    const scaled = names.map((name) => points[name].map((metres) => metres / 8));
    const image = await toolbox.project(camera, scaled);
    image[1][0] += 25; // a wrong click
    const found = await toolbox.calibrate({ width: 224, height: 224, intrinsic: camera.intrinsic, world: scaled, image });
    const refused = await toolbox.calibrate({ width: 224, height: 224, world: [], image: [] }).catch((thrown) => [thrown.name, thrown.message]);
    toolbox.dispose();
    return { centre: found.camera.camera_from_world, rms: found.rms_px, outliers: found.outliers.map(({ index }) => index), courts, refused };
  }, samples[0].camera);
  assert.ok(courts.includes("tennis") && courts.length >= 5, courts.join());
  assert.ok(rms < 1e-3, `${rms} px`);
  assert.deepEqual(outliers, [1]);
  centre.flat().forEach((value, index) => assert.ok(Math.abs(value - samples[0].camera.camera_from_world.flat()[index]) < 1e-3));
  assert.equal(refused[0], "GravisightError");
});

test("a thrown ball is simulated, drawn, labelled, and its track fitted", async () => {
  const { worst, sigma, bounces, explained, labels, speed, order } = await page.evaluate(throwOne);
  assert.ok(explained && worst < 0.03, `off by ${worst} m`);
  assert.ok(sigma < 0.05, `${sigma} m`);
  assert.ok(bounces >= 1 && bounces <= 6, `${bounces} bounces`);
  assert.ok(Math.abs(speed - 1) < 0.05, `${speed} m/s after a start at 1 m/s sideways`);
  assert.ok(labels.found >= 0.8 && labels.median < 1, JSON.stringify(labels));
  assert.equal(order, "timestamp-order");
});

test("fine-tuning on 2D labels of another camera lowers its error by a fifth, and the command finds the same with its export", { timeout: 600_000 }, async () => {
  const result = await page.evaluate(fineTune, { model: "models/sd-s.json", steps: 60 });
  const { before, after, steps, aborted, card, weights, found, camera, png } = result;
  console.log(`held-out forecast error ${before.forecast_px} -> ${after.forecast_px} px, DtG ${before.dtg.mean} -> ${after.dtg.mean} m, ${result.seconds} s`);
  assert.equal(steps, 60);
  assert.deepEqual(aborted, ["AbortError", true]);
  assert.ok(after.forecast_px < 0.8 * before.forecast_px);
  assert.ok(after.dtg.mean < 0.8 * before.dtg.mean);
  const folder = mkdtempSync(join(tmpdir(), "gravisight-"));
  const { name, weights: file } = JSON.parse(card);
  writeFileSync(join(folder, `${name}.json`), card);
  writeFileSync(join(folder, file), Buffer.from(weights, "base64"));
  writeFileSync(join(folder, "camera.json"), JSON.stringify(camera));
  writeFileSync(join(folder, "frame.png"), Buffer.from(png, "base64"));
  const native = JSON.parse(gravisight(["localise", "frame.png", "--camera", "camera.json", "--model", name, "--json"], { cwd: folder }));
  native.world.forEach((value, axis) => assert.ok(Math.abs(value - found[axis]) < 1e-3, `${native.world} is not ${found}`));
});

test("saliency comes on request, in a build that is fetched for it", async () => {
  const { without, size, strongest } = await page.evaluate(async ({ model, camera, base64 }) => {
    const localiser = await window.gravisight.Localiser.create({ model, camera });
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const without = Object.keys(await localiser.localise(bytes)).sort();
    const { saliency, image } = await localiser.localise(bytes, { saliency: true });
    localiser.dispose();
    const peak = saliency.values.reduce((best, value, index) => (Math.abs(value) > Math.abs(saliency.values[best]) ? index : best), 0);
    const at = [peak % saliency.width, Math.floor(peak / saliency.width)];
    return { without, size: [saliency.width, saliency.height], strongest: Math.max(Math.abs(at[0] - image[0]), Math.abs(at[1] - image[1])) };
  }, { model: CARD, camera: samples[0].camera, base64: pictureBase64(0) });
  assert.deepEqual(without, ["camera", "confidence", "depth", "device", "image", "milliseconds", "notes", "world"]);
  assert.deepEqual(size, [224, 224]);
  assert.ok(strongest < 40, `${strongest} px from the ball`);
});

test("the camera is set once, changed, or given with the picture; without one the error says so", async () => {
  const result = await page.evaluate(async ({ model, cameras, base64 }) => {
    const { Localiser } = window.gravisight;
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const localiser = await Localiser.create({ model });
    const missing = await localiser.localise(bytes).catch((thrown) => thrown.code);
    localiser.setCamera(cameras[0]);
    const first = (await localiser.localise(bytes)).world;
    const given = (await localiser.localise(bytes, { camera: cameras[1] })).world;
    localiser.setCamera(cameras[1]);
    const second = (await localiser.localise(bytes)).world;
    localiser.dispose();
    localiser.dispose();
    const late = [await localiser.localise(bytes).catch((thrown) => thrown.code)];
    try {
      localiser.setCamera(cameras[0]);
    } catch (thrown) {
      late.push(thrown.code);
    }
    const disposable = typeof Symbol.dispose === "symbol" && typeof localiser[Symbol.dispose] === "function";
    return { missing, first, given, second, late, disposable, has: typeof Symbol.dispose };
  }, { model: CARD, cameras: [samples[0].camera, samples[1].camera], base64: pictureBase64(0) });
  assert.equal(result.missing, "camera-missing");
  assert.deepEqual(result.given, result.second);
  assert.notDeepEqual(result.first, result.second);
  assert.deepEqual(result.late, ["disposed", "disposed"]);
  assert.equal(result.disposable, result.has === "symbol");
});

test("weights are kept by their sha256, taken without a network, and forgotten on request", async () => {
  const fresh = await harness();
  const load = (options = {}) => fresh.evaluate(async ({ model, options }) => {
    const localiser = await window.gravisight.Localiser.create({ model, ...options });
    localiser.dispose();
    return window.gravisight.isCached(model);
  }, { model: CARD, options });
  assert.equal(await fresh.evaluate((model) => window.gravisight.isCached(model), CARD), false);
  assert.equal(await load({ cache: false }), false);
  assert.equal(await load(), true);
  let asked = 0;
  await fresh.route("**/models/**", (route) => ((asked += 1), route.abort()));
  assert.equal(await load(), true);
  assert.equal(asked, 1, "the card is asked for, the weights are not");
  await fresh.evaluate(() => window.gravisight.clearCache());
  assert.equal(await fresh.evaluate((model) => window.gravisight.isCached(model), CARD), false);
  await fresh.close();
  // The browser itself reports what was cut off.
  assert.deepEqual(complaints.splice(0).filter((complaint) => !complaint.includes("ERR_FAILED")), []);
});

test("two thousand frames take no more memory than the first hundred", { timeout: 300_000 }, async () => {
  const own = await harness();
  const heap = await heapOf(own);
  await own.evaluate(prepareSoak, { model: CARD, camera: samples[0].camera });
  const first = { wasm: await own.evaluate(soak, { from: 1, to: 100 }), heap: await heap() };
  const last = { wasm: await own.evaluate(soak, { from: 101, to: 2000 }), heap: await heap() };
  await own.close();
  assert.ok(Math.abs(last.wasm - first.wasm) <= 2e6, `wasm ${first.wasm} to ${last.wasm} bytes`);
  assert.ok(last.heap - first.heap <= 2e6, `JavaScript ${first.heap} to ${last.heap} bytes`);
});

test("a hundred localisers, made and disposed of, leave nothing behind", { timeout: 300_000 }, async () => {
  const heap = await heapOf(page);
  const make = (count) => page.evaluate(async ({ model, camera, count }) => {
    for (let made = 0; made < count; made++) {
      const localiser = await window.gravisight.Localiser.create({ model, camera });
      await localiser.localise(new ImageData(224, 224));
      localiser.dispose();
    }
  }, { model: CARD, camera: samples[0].camera, count });
  await make(5);
  const first = await heap();
  await make(95);
  const last = await heap();
  assert.ok(last - first <= 2e6, `${first} to ${last} bytes`);
  assert.equal(page.workers().length, 0, "every Worker has ended");
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});

/** Bytes that a page's own thread uses after a collection of garbage. */
async function heapOf(of) {
  const session = await of.context().newCDPSession(of);
  return async () => {
    await session.send("HeapProfiler.collectGarbage");
    return (await session.send("Runtime.getHeapUsage")).usedSize;
  };
}

function pictureBase64(index) {
  return readFileSync(new URL(`../../web/public/samples/${samples[index].file}`, import.meta.url)).toString("base64");
}

// The functions below run in the page.

async function throwOne() {
  const { Toolbox, Track } = window.gravisight;
  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const times = Array.from({ length: 90 }, (_, index) => index / 60);
  const path = await simulator.path({ position: [0.6, 0.5, 1.6], velocity: [-1, 0, -1.4] }, times);
  const images = await toolbox.project(simulator.camera, path);
  const track = await Track.create({ camera: simulator.camera, scene: simulator.scene, toolbox });
  // Every fifth frame is not seen, and one sighting is not to be believed.
  images.forEach((image, index) => track.add({ timestampMs: 1000 + times[index] * 1000, image: index % 5 === 4 ? null : image, confidence: 0.99 }));
  track.add({ timestampMs: 1000 + 1500, image: [3, 3], confidence: 0.01 });
  let order = "taken";
  try {
    track.add({ timestampMs: 2, image: null });
  } catch (thrown) {
    order = thrown.code;
  }
  const { points, bounces, explained } = await track.fit();
  const off = points.slice(0, 90).map(({ world }, index) => Math.hypot(...world.map((value, axis) => value - path[index][axis])));
  const frames = [];
  for (let index = 0; index < 30; index++) {
    const { data, width, height } = await simulator.picture(path[index]);
    frames.push(new ImageData(data, width, height));
  }
  const proposals = await toolbox.proposeLabels(frames, { camera: simulator.camera });
  const errors = proposals.flatMap((label, index) => (label ? [Math.hypot(label.image[0] - images[index][0], label.image[1] - images[index][1])] : []));
  errors.sort((a, b) => a - b);
  toolbox.dispose();
  return {
    worst: Math.max(...off),
    sigma: Math.max(...points.slice(0, 90).map(({ sigma }) => sigma)),
    speed: Math.hypot(points[0].velocity[0], points[0].velocity[1]),
    bounces: bounces.length,
    explained,
    labels: { found: errors.length / frames.length, median: errors[Math.floor(errors.length / 2)] },
    order,
  };
}

async function fineTune({ model, steps }) {
  const { FineTuner, Localiser, Toolbox } = window.gravisight;
  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 2 });
  const clip = async (number) => {
    const { fps, frames } = await simulator.clip(7, number);
    const drawn = [];
    for (const { t, image, world } of frames) {
      const { data, width, height } = await simulator.picture(world);
      drawn.push({ picture: new ImageData(data, width, height), t, image, world });
    }
    return { id: `clip ${number}`, fps, camera: simulator.camera, scene: simulator.scene, frames: drawn };
  };
  const tuner = await FineTuner.create({ model, steps, batch: 8 });
  for (const number of [0, 1, 2, 3]) {
    const given = await clip(number);
    // The 3D truth is for scoring only.
    given.frames = given.frames.map(({ world: _, ...frame }) => frame);
    await tuner.addClip(given);
  }
  const held = await clip(50);
  for (const other of [held, await clip(51), await clip(52)]) await tuner.addClip(other, { heldOut: true });
  const before = await tuner.evaluate();
  const start = performance.now();
  let made = 0;
  const controller = new AbortController();
  const aborting = await tuner.step(steps, { signal: controller.signal, onStep: () => ++made === 3 && controller.abort() }).catch((thrown) => thrown.name);
  const goesOn = (await tuner.step(1)).step;
  await tuner.step(steps);
  const seconds = (performance.now() - start) / 1000;
  const after = await tuner.evaluate();
  const { card, weights } = await tuner.export();
  tuner.dispose();
  toolbox.dispose();
  const url = (content, type) => URL.createObjectURL(new Blob([content], { type }));
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 224;
  canvas.getContext("2d").putImageData(held.frames[10].picture, 0, 0);
  const png = canvas.toDataURL("image/png").split(",")[1];
  const weightsUrl = url(weights, "application/octet-stream");
  const cardUrl = url(JSON.stringify({ ...JSON.parse(card), weights: weightsUrl }), "application/json");
  const localiser = await Localiser.create({ model: cardUrl, camera: simulator.camera, cache: false });
  const found = (await localiser.localise(Uint8Array.from(atob(png), (c) => c.charCodeAt(0)))).world;
  localiser.dispose();
  let binary = "";
  for (let index = 0; index < weights.length; index += 8192) binary += String.fromCharCode(...weights.subarray(index, index + 8192));
  return { before, after, steps, seconds, aborted: [aborting, goesOn >= 4], card, weights: btoa(binary), found, camera: simulator.camera, png };
}

/** On the page's own thread, where its memory can be seen. */
async function prepareSoak({ model, camera }) {
  const instantiate = WebAssembly.instantiate;
  WebAssembly.instantiate = async (...given) => {
    const made = await instantiate(...given);
    window.memory = (made.instance ?? made).exports.memory;
    return made;
  };
  window.localiser = await window.gravisight.Localiser.create({ model, camera, worker: false });
  WebAssembly.instantiate = instantiate;
}

async function soak({ from, to }) {
  const canvas = new OffscreenCanvas(224, 224);
  const context = canvas.getContext("2d");
  for (let frame = from; frame <= to; frame++) {
    context.fillStyle = `hsl(${frame % 360} 50% 50%)`;
    context.fillRect(0, 0, 224, 224);
    const picture = new VideoFrame(canvas, { timestamp: frame * 33000 });
    const { timestampMs } = await window.localiser.localiseVideoFrame(picture, frame * 33);
    picture.close();
    if (timestampMs !== frame * 33) throw new Error(`${timestampMs} ms for frame ${frame}`);
  }
  return window.memory.buffer.byteLength;
}
