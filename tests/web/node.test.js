/** The package in Node.js, from its files: no browser, no server. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { FineTuner, GravisightError, isCached, Localiser, Toolbox, VideoTracker } from "gravisight";
import { pictureOf, samples } from "./support/demo.js";

const model = new URL("../../models/sd-l.json", import.meta.url);
const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));

/** Of a tracked video: see there. */
const ASTRAY = 30;

test("pictures are found where the command finds them", async () => {
  const stages = new Set();
  const localiser = await Localiser.create({ model, camera: samples[0].camera, device: "auto", onProgress: ({ stage }) => stages.add(stage) });
  // The wasm and the weights are fetched side by side.
  assert.deepEqual([...stages].sort(), ["warming up", "wasm", "weights"]);
  assert.equal([...stages].at(-1), "warming up");
  assert.deepEqual(localiser.card, JSON.parse(readFileSync(model, "utf8")));
  assert.match(localiser.device.name, /CPU/);
  assert.match(localiser.device.reason, /auto: .*no WebGPU/);
  for (const sample of samples) {
    const { world } = await localiser.localise(pictureOf(sample), { camera: sample.camera });
    world.forEach((value, axis) => assert.ok(Math.abs(value - golden[sample.file].world[axis]) < 1e-3, sample.file));
  }
  const controller = new AbortController();
  const running = localiser.localise(pictureOf(samples[0]), { signal: controller.signal });
  controller.abort();
  await assert.rejects(running, { name: "AbortError" });
  assert.equal((await localiser.localise(pictureOf(samples[0]))).world.length, 3);
  localiser.dispose();
  await assert.rejects(localiser.localise(pictureOf(samples[0])), { code: "disposed" });
});

test("without a model the package's own finds a ball of any size, and says how sure it is", async () => {
  const localiser = await Localiser.create({ camera: samples[0].camera, ball: { radius: 0.2 } });
  assert.equal(localiser.card.name, "any");
  const found = await localiser.localise(pictureOf(samples[0]), { candidates: 3 });
  const [first] = found.candidates;
  assert.ok(found.candidates.length <= 3 && first.world.every((value, axis) => value === found.world[axis]));
  assert.ok(found.depthSigma > 0 && found.radiusPx > 1 && found.covariance[2][2] > 0);
  // Twice as large a ball is twice as far away.
  const larger = await localiser.localise(pictureOf(samples[0]), { ball: { radius: 0.4 } });
  assert.ok(Math.abs(larger.depth / found.depth - 2) < 1e-3, `${larger.depth} ${found.depth}`);
  localiser.setBall({ radius: 33.5 });
  await assert.rejects(localiser.localise(pictureOf(samples[0])), (thrown) => /0\.0335/.test(thrown.message) && thrown.code === "value");
  localiser.dispose();
  const without = await Localiser.create({ camera: samples[0].camera });
  await assert.rejects(without.localise(pictureOf(samples[0])), /radius/);
  without.dispose();
});

test("a model in memory is its card's text and its weights' bytes; anything else is refused in words", async () => {
  const [card, weights] = [model, new URL("sd-l.safetensors", model)].map((file) => readFileSync(file));
  const localiser = await Localiser.create({ model: { card: card.toString(), weights } });
  assert.equal(localiser.card.name, "sd-l");
  localiser.dispose();
  const refused = async (wrong, what) =>
    await assert.rejects(Localiser.create({ model: wrong }), (thrown) => thrown.code === "model-format" && what.test(thrown.message));
  await refused({ card: JSON.parse(card), weights }, /the text of its JSON file, not object/);
  await refused(null, /the text of its JSON file, not undefined/);
  await refused({ card: card.toString(), weights: [1, 2] }, /Uint8Array, not object/);
  await refused({ card: card.toString() }, /Uint8Array, not undefined/);
  await assert.rejects(Localiser.create({ model: { card: "{", weights } }), (thrown) => thrown instanceof GravisightError);
});

test("a path works as a model, and a wrong one is refused in words", async () => {
  const localiser = await Localiser.create({ model: fileURLToPath(model) });
  localiser.dispose();
  await assert.rejects(Localiser.create({ model: "nowhere.json" }), (thrown) => {
    assert.ok(thrown instanceof GravisightError);
    assert.equal(thrown.code, "fetch");
    return /nowhere\.json/.test(thrown.message);
  });
  assert.equal(await isCached(model), false);
});

test("the tools run, several at the same time", async () => {
  const [one, other] = await Promise.all([Toolbox.create(), Toolbox.create()]);
  const [court, spring] = await Promise.all([one.court("tennis"), other.simulator({ environment: "spring" })]);
  assert.ok(Object.keys(court.points).length > 10);
  assert.ok(spring.scene.spring.stiffness > 0);
  await assert.rejects(one.court("quidditch"), { name: "GravisightError" });
  await assert.rejects(one.simulator({ environment: 7 }), { name: "GravisightError" });
  one.dispose();
  other.dispose();
  await assert.rejects(one.courts(), { code: "disposed" });
});

test("how unsure a camera is enters the flight's uncertainty", async () => {
  const toolbox = await Toolbox.create();
  const scene = await toolbox.scene("volleyball");
  const truth = { width: 1920, height: 1080, intrinsic: [[1500, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]], camera_from_world: [[0, 1, 0, 0], [0, 0, -1, 2], [-1, 0, 0, 12], [0, 0, 0, 1]] };
  const { points } = await toolbox.court("volleyball");
  const names = ["near corner left", "far corner left", "near attack line left", "far attack line left", "near corner right", "far corner right"].filter((name) => points[name]);
  const clicks = (await toolbox.project(truth, names.map((name) => points[name]))).map(([x, y], index) => [x + (index % 2 ? 3 : -3), y + (index % 3 ? 2 : -2)]);
  const found = await toolbox.calibrate({ width: 1920, height: 1080, court: "volleyball", names, image: clicks });
  assert.ok(found.oneSigma.length >= 6 && Array.isArray(found.doubts) && found.centre.length === 3);
  const times = [...Array(40).keys()].map((frame) => frame / 40);
  const { states } = await toolbox.forecast(scene, { position: [0, -5, 1.2], velocity: [0.5, 8, 0.5] }, times);
  const seen = await toolbox.project(found.camera, states.map(([x, y, z]) => [x, y, z]));
  const frames = times.map((time, index) => ({ time, image: seen[index] }));
  const mean = ({ frames: fitted }) => fitted.reduce((sum, { sigma }) => sum + sigma, 0) / fitted.length;
  const [without, withIt] = await Promise.all([[], found.oneSigma].map((cameraSigma) => toolbox.fitTrack(frames, { camera: found.camera, scene, cameraSigma })));
  assert.ok(mean(withIt) > mean(without) * 1.005, `${mean(withIt)} ${mean(without)}`);
  await assert.rejects(toolbox.fitTrack(frames, { camera: found.camera, scene, cameraSigma: [{}] }), /cameraSigma/);
  toolbox.dispose();
});

test("a ball is tracked through frames, near the truth; what is missing or wrong is said by name", async () => {
  const toolbox = await Toolbox.create();
  assert.ok((await toolbox.scenes()).includes("tennis"));
  assert.ok((await toolbox.scene("tennis")).net.length > 1);
  await assert.rejects(toolbox.scene("quidditch"), /quidditch.*tennis/);
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const { camera, scene } = simulator;
  const { frames } = await simulator.clip(2024, 3);
  const tracker = await VideoTracker.create();
  for (const [index, { t, world: [x, y, z] }] of frames.slice(0, 60).entries()) {
    // In one frame the ball is where no ball can be: four pixels beside its way.
    const drawn = index === ASTRAY ? [x + 0.12, y, z] : [x, y, z];
    await tracker.add(await simulator.picture(drawn), 5000 + 1000 * t);
  }
  await assert.rejects(tracker.add(await simulator.picture(frames[60].world), 5000), { code: "timestamp-order" });
  await assert.rejects(tracker.track({ camera }), { code: "scene-missing" });
  await assert.rejects(tracker.track({ camera: { ...camera, width: 300, height: 100 }, scene }), { code: "camera-mismatch" });
  await assert.rejects(tracker.track({ camera, scene, seeds: [{ frame: 60, image: [1, 1] }] }), /frame 60, but the last frame is 59/);

  // A camera alone makes no metres, and is no mistake where the tracker was made with it.
  const flat = await VideoTracker.create({ camera });
  for (const { t, world } of frames.slice(0, 12)) await flat.add(await simulator.picture(world), 1000 * t);
  assert.equal((await flat.track()).explained, null);
  flat.dispose();

  const inPicture = await tracker.track();
  assert.equal(inPicture.explained, null);
  assert.ok(inPicture.frames.length === 60 && inPicture.frames.every(({ world }) => world === null));
  const progress = [];
  const found = await tracker.track({ camera, scene, timesKnown: true, onProgress: ({ stage, loaded, total }) => progress.push([stage, loaded, total]) });
  assert.deepEqual(progress, [["fit", 1, 1]]);
  assert.ok(found.explained, found.verdict);
  assert.ok(found.impacts.length > 0 && found.hits.length === 0 && found.flights.length === 1);
  const near = found.frames.filter(({ image }, index) => image && Math.hypot(image[0] - frames[index].image[0], image[1] - frames[index].image[1]) < 1);
  assert.ok(near.length >= 57, `${near.length} of 60 frames`);
  const off = found.frames.map(({ world }, index) => Math.hypot(...world.map((value, axis) => value - frames[index].world[axis]))).sort((a, b) => a - b);
  assert.ok(off[30] < 0.03, `${off[30]} m`);
  assert.ok(found.frames.every(({ time, sigma, flight }, index) => Math.abs(time - 5 - frames[index].t) < 1e-9 && sigma > 0 && flight === 0));
  assert.deepEqual(found.frames.flatMap(({ outlier }, index) => (outlier ? [index] : [])), [ASTRAY]);
  await assert.rejects(tracker.add(await simulator.picture(frames[60].world), 1e6), /after the end of the video/);
  tracker.dispose();
  await assert.rejects(tracker.track(), { code: "disposed" });

  const sized = await VideoTracker.create({ model });
  await assert.rejects(sized.add(await simulator.picture(frames[0].world), 0), /must be "size"/);
  sized.dispose();
  toolbox.dispose();
});

test("the package knows its own version: what was measured counts for that one alone", async () => {
  const { VERSION } = await import("../../pkg/dist/version.js");
  assert.equal(VERSION, JSON.parse(readFileSync(new URL("../../pkg/package.json", import.meta.url), "utf8")).version);
});

test("a fine-tuner refuses senseless options by name", async () => {
  await assert.rejects(FineTuner.create({ model, crop: 33 }), /crop/);
  await assert.rejects(FineTuner.create({ model, steps: NaN }), { code: "options-not-finite" });
});
