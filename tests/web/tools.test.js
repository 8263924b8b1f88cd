/** The package's Toolbox, Track and FineTuner, its cache and its memory, in a page that offers it as `window.gravisight`. */
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { gravisight } from "./support/command.js";
import { samples } from "./support/demo.js";
import { fineTune, prepareSoak, soak, throwOne } from "./support/in-page.js";
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
    return { centre: found.camera.camera_from_world, rms: found.rmsPx, outliers: found.outliers.map(({ index }) => index), courts, refused };
  }, samples[0].camera);
  assert.ok(courts.includes("tennis") && courts.length >= 5, courts.join());
  assert.ok(rms < 1e-3, `${rms} px`);
  assert.deepEqual(outliers, [1]);
  centre.flat().forEach((value, index) => assert.ok(Math.abs(value - samples[0].camera.camera_from_world.flat()[index]) < 1e-3));
  assert.equal(refused[0], "GravisightError");
});

test("a thrown ball is simulated, and its track fitted", async () => {
  const { worst, sigma, bounces, explained, speed, order } = await page.evaluate(throwOne);
  assert.ok(explained && worst < 0.03, `off by ${worst} m`);
  // Exact labels are taken to be known to half a pixel at best, which leaves so much of the distance open.
  assert.ok(sigma < 0.11, `${sigma} m`);
  assert.ok(bounces >= 1 && bounces <= 6, `${bounces} bounces`);
  assert.ok(Math.abs(speed - 1) < 0.05, `${speed} m/s after a start at 1 m/s sideways`);
  assert.equal(order, "timestamp-order");
});

test("fine-tuning on 2D labels of another camera cuts the distance to the truth to a third, and the command finds the same with its export", { timeout: 600_000 }, async () => {
  const result = await page.evaluate(fineTune, { model: "models/sd-s.json", steps: 60 });
  const { before, after, steps, aborted, card, weights, found, camera, png } = result;
  console.log(`held-out forecast error ${before.forecastPx} -> ${after.forecastPx} px, DtG ${before.dtg.mean} -> ${after.dtg.mean} m, ${result.seconds} s`);
  assert.equal(steps, 60);
  assert.deepEqual(aborted, ["AbortError", true]);
  // Six seeds end at 0.96 to 1.27 px and 11.8 to 15.3 cm.
  assert.ok(after.forecastPx < before.forecastPx);
  assert.ok(after.dtg.mean < 1.3 * 0.127);
  const folder = mkdtempSync(join(tmpdir(), "gravisight-"));
  const { name, weights: file } = JSON.parse(card);
  writeFileSync(join(folder, `${name}.json`), card);
  writeFileSync(join(folder, file), Buffer.from(weights, "base64"));
  writeFileSync(join(folder, "camera.json"), JSON.stringify(camera));
  writeFileSync(join(folder, "frame.png"), Buffer.from(png, "base64"));
  const native = JSON.parse(gravisight(["localise", "frame.png", "--camera", "camera.json", "--model", name, "--json"], { cwd: folder }));
  native.world.forEach((value, axis) => assert.ok(Math.abs(value - found[axis]) < 1e-3, `${native.world} is not ${found}`));
});

test("a clip with a picture that is none is refused, and the next one is taken", async () => {
  const { code, added } = await page.evaluate(async (model) => {
    const { FineTuner, Toolbox } = window.gravisight;
    const toolbox = await Toolbox.create();
    const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
    const { fps, frames } = await simulator.clip(5, 0);
    const drawn = [];
    for (const { t, image, world } of frames.slice(0, 60)) {
      const { data, width, height } = await simulator.picture(world);
      drawn.push({ t, image, picture: new ImageData(data, width, height) });
    }
    const clip = { id: "clip", fps, camera: simulator.camera, scene: simulator.scene, frames: drawn };
    const tuner = await FineTuner.create({ model });
    const torn = drawn.map((frame, index) => (index === 20 ? { ...frame, picture: new Uint8Array(40) } : frame));
    const code = await tuner.addClip({ ...clip, frames: torn }).then(() => "taken", (thrown) => thrown.code);
    const added = await tuner.addClip(clip);
    tuner.dispose();
    toolbox.dispose();
    return { code, added };
  }, "models/sd-s.json");
  assert.equal(code, "image-decode");
  assert.equal(added.leftOut, undefined);
  assert.ok(added.frames >= 50, `${added.frames} frames teach`);
});

test("saliency comes on request", async () => {
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
  assert.deepEqual(without, ["ballFound", "camera", "confidence", "confidenceKind", "depth", "depthSigma", "device", "image", "milliseconds", "notes", "world"]);
  assert.deepEqual(size, [224, 224]);
  assert.ok(strongest < 40, `${strongest} px from the ball`);
});

test("of a model that reads sizes saliency is in metres, around the ball, too", async () => {
  const { size, strongest, most, depth } = await page.evaluate(async ({ camera, base64 }) => {
    const localiser = await window.gravisight.Localiser.create({ camera, ball: { radius: 0.2 } });
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const { saliency, image, depth } = await localiser.localise(bytes, { saliency: true });
    localiser.dispose();
    const peak = saliency.values.reduce((best, value, index) => (Math.abs(value) > Math.abs(saliency.values[best]) ? index : best), 0);
    const at = [peak % saliency.width, Math.floor(peak / saliency.width)];
    return { size: [saliency.width, saliency.height], strongest: Math.max(Math.abs(at[0] - image[0]), Math.abs(at[1] - image[1])), most: Math.abs(saliency.values[peak]), depth };
  }, { camera: samples[0].camera, base64: pictureBase64(0) });
  assert.deepEqual(size, [224, 224]);
  // The brightness of its edge moves the depth by centimetres to a metre, not by shares of it.
  assert.ok(strongest < 20 && most > 0.005 * depth && most < depth, `${strongest} px from the ball, ${most} of ${depth} m`);
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
