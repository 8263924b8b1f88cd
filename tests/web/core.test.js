/** Every parameter of what the wasm core offers, and every field of its options, has an effect: one that is not read fails here. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import * as core from "../../pkg/wasm/cpu/gravisight.js";
import { drawnCourt } from "./support/court.js";
import { pictureOf, samples } from "./support/demo.js";
import { film, filming, followed } from "./support/throw.js";

const file = (path) => readFileSync(new URL(`../../${path}`, import.meta.url));
const TYPES = file("pkg/wasm/cpu/gravisight.d.ts").toString();
await core.default({ module_or_path: file("pkg/wasm/cpu/gravisight_bg.wasm") });

const [card, weights] = [file("models/any.json").toString(), file("models/any.safetensors")];
const localiser = await core.Localiser.create(card, weights, "cpu");
const simulator = new core.Simulator(1, 2);
const frames = film();
const seen = [samples[0], samples[2]].map((sample) => pictureOf(sample));
const json = JSON.stringify;
const camera = json(samples[0].camera);
/** One metre farther away. */
const away = ({ camera_from_world: [x, y, [a, b, c, depth]], ...rest }) => ({ ...rest, camera_from_world: [x, y, [a, b, c, depth + 1], [0, 0, 0, 1]] });
const farther = json(away(samples[0].camera));
const floor = core.scene("floor");
const bad = json({ ...floor, gravity: "down" });
const tennis = { width: 1920, height: 1080, court: "tennis", names: ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"], image: [[312.5, 905], [1630, 897.5], [601, 322], [1297, 319.5]] };
const court = drawnCourt(core.court("tennis").lines);
const times = Array.from({ length: 20 }, (_, frame) => frame / 40);
const start = [-0.5, 0, 1, 0.5, 0.2, 2];
const pixels = core.project(json(filming), core.forecast(json(floor), start, times).states.flatMap(([x, y, z]) => [x, y, z]));
const track = times.map((time, index) => ({ time, image: [pixels[2 * index], pixels[2 * index + 1]] }));
const fitted = (...given) => {
  const { frames, flights } = core.fitTrack(...given);
  return [frames.map(({ world, sigma }) => [world, sigma]), flights.map(({ reason }) => reason)];
};

/** What a call comes to: the same for the same arguments. */
async function outcome(call, given) {
  try {
    const { milliseconds, ...result } = Object((await call(...given)) ?? {});
    return json(result);
  } catch (thrown) {
    return `${thrown.code}: ${thrown.message}`;
  }
}

/** Each parameter is changed alone, to its place in `others`: that must change what comes out. */
async function each(name, call, given, others) {
  const plain = await outcome(call, given);
  assert.equal(await outcome(call, given), plain, `${name} gives the same twice`);
  assert.doesNotMatch(plain, /^undefined:/, name);
  for (const [index, other] of others.entries()) {
    const changed = given.with(index, other);
    assert.notEqual(await outcome(call, changed), plain, `parameter ${index + 1} of ${name} has no effect`);
  }
}

const tuner = () => core.FineTuner.create(card, weights, json({ steps: 3, batch: 1, crop: 64 }), "cpu");
const ofTuner = (made) => json([made.progress(), made.deviceName]);
const { fps, frames: labels } = simulator.clip(7, 0);
const drawn = labels.slice(0, 12);
const line = (id) => json({ id, fps, camera: simulator.camera, scene: simulator.scene, frames: drawn.map(({ t, image, world }, index) => ({ file: `${index}`, t, image, world, visible: true })) });
const paint = (world) => ({ data: simulator.picture(world), width: simulator.camera.width, height: simulator.camera.height });
/** What becomes of a clip, and what of it a run that goes on asks for. */
async function clipAdded(clip, heldOut) {
  const made = await tuner();
  for (const { world } of drawn) await made.addPicture(paint(world));
  const added = made.addClip(clip, heldOut);
  return [added, await made.checkpoint().then((bytes) => core.FineTuner.resume(bytes, "cpu")).then((again) => again.progress())];
}
const checkpoint = await (await tuner()).checkpoint();

/** An adapter that was given a film, with its flights; what it learns from, by its first loss. */
async function adapted({ track = followed(frames), seeds = "[]", picture, time } = {}) {
  const made = await core.Adapter.create(card, weights, json({ steps: 1 }), "cpu");
  const flights = made.begin(typeof track === "string" ? track : json(track), seeds);
  if (picture) {
    await made.add(frames[0].picture, 0.5);
    await made.add(picture, time);
  }
  for (const [frame, each] of (picture ? [] : frames).entries()) await made.add(each.picture, frame / 30);
  if (!picture) await made.end();
  return { made, flights };
}
const ofAdapter = (made) => json([made.progress(), made.deviceName]);
const { made: adapter } = await adapted();
await adapter.step();
const aside = await adapter.checkpoint();
const unsure = json({ ...followed(frames), frames: followed(frames).frames.map((frame) => ({ ...frame, confidence: 0.6 })) });

/** A tracker that has seen that film; `filmedBy` holds its camera and the tracker's numbers, as JSON. */
async function watched(given = frames, times = 33, ...filmedBy) {
  const tracker = localiser.tracker(...filmedBy);
  for (const [frame, { picture }] of given.entries()) await tracker.add(picture, (frame * times) / 1000);
  return tracker;
}
const spotted = await watched();
const known = { camera: filming, scene: { ...floor, ball: { ...floor.ball, radius: 0.1 } } };
const tracked = async (given, onProgress = () => {}) => {
  const { findings, frames } = await spotted.track(json(given), onProgress);
  return [findings, frames];
};
let heard;

/** By the name of the declaration: a call, its arguments, and for each another one. */
const CASES = {
  calibrate: [core.calibrate, [json(tennis), [], undefined], [json({ ...tennis, width: 1930 }), ["colour"], seen[0]]],
  findCourt: [core.findCourt, [court, "tennis", []], [seen[0], "badminton", ["colour"]]],
  court: [core.court, ["tennis"], ["padel"]],
  courtWithLines: [core.courtWithLines, ["tennis"], ["basketball"]],
  scene: [core.scene, ["tennis"], ["padel"]],
  sceneWithBall: [core.sceneWithBall, [json(floor), 0.11], [json({ ...floor, gravity: [0, 0, -3] }), -1]],
  project: [(...given) => [...core.project(...given)], [json(filming), [0, 0, 2]], [json(away(filming)), [0, 0, 1]]],
  ballAt: [core.ballAt, [json(filming), { centre: [80, 60], radiusPx: 12 }, 0.1, "[]"], [json(away(filming)), { centre: [80, 60], radiusPx: 14 }, 0.2, json([away(filming)])]],
  assumedCamera: [core.assumedCamera, [{ width: 400, height: 300 }], [{ width: 440, height: 300 }]],
  forecast: [core.forecast, [json(floor), start, times], [json({ ...floor, gravity: [0, 0, -3] }), start.with(0, 1), times.slice(3)]],
  fitTrack: [fitted, [json(track), json(filming), json(floor), 0.5, [], json([away(filming)]), false], [json(track.slice(2)), json(away(filming)), bad, 4, ["mass"], "[]", true]],
  "Simulator.constructor": [(...given) => [new core.Simulator(...given)].map(({ camera, scene }) => [camera, scene]), [1, 1], [undefined, 2]],
  "Simulator.clip": [simulator.clip.bind(simulator), [7, 0], [8, 1]],
  "Simulator.path": [(...given) => [...simulator.path(...given)], [start, times], [start.with(0, 0.1), times.slice(2)]],
  "Simulator.picture": [(...given) => [...simulator.picture(...given)], [[0, 0, 1]], [[0.2, 0, 1]]],
  "Localiser.create": [async (...given) => (await core.Localiser.create(...given)).deviceName, [card, weights, "cpu"], ["{}", weights.subarray(1), "abacus"]],
  "Localiser.localise": [(...given) => localiser.localise(...given), [seen[0], camera, { ballRadius: 0.2 }], [seen[1], farther, { ballRadius: 0.4 }]],
  "Localiser.saliency": [async (...given) => [...(await localiser.saliency(...given)).values].slice(0, 5000), [seen[0]], [seen[1]]],
  "Localiser.tracker": [async (...given) => (await watched(frames.slice(0, 1), 33, ...given)) && 1, [json(filming), "{}", "tennis"], [json({ ...filming, width: 400 }), json({ spells: 1 }), "squash"]],
  "VideoTracker.add": [
    async (picture, time) => {
      const tracker = await watched(frames.slice(0, 8));
      await tracker.add(picture, time);
      return (await tracker.track("{}", () => {})).frames;
    },
    [frames[8].picture, 1],
    [{ width: 8, height: 8, data: new Uint8Array(256) }, 2],
  ],
  "VideoTracker.track": [async (given, onProgress) => (heard = 0, await spotted.track(given, onProgress), [(await tracked(JSON.parse(given)))[0], heard]), [json(known), () => heard++], ["{}", () => {}]],
  "FineTuner.create": [async (...given) => ofTuner(await core.FineTuner.create(...given)), [card, weights, "{}", "cpu"], ["{}", weights.subarray(1), json({ steps: 7 }), "abacus"]],
  "FineTuner.resume": [async (...given) => ofTuner(await core.FineTuner.resume(...given)), [checkpoint, "cpu"], [checkpoint.subarray(1), "abacus"]],
  "FineTuner.addPicture": [async (picture) => (await (await tuner()).addPicture(picture), "added"), [seen[0]], [new Uint8Array([1, 2, 3])]],
  "Adapter.create": [async (...given) => ofAdapter(await core.Adapter.create(...given)), [card, weights, "{}", "cpu"], ["{}", weights.subarray(1), json({ steps: 7 }), "abacus"]],
  "Adapter.resume": [async (...given) => ofAdapter(await core.Adapter.resume(...given)), [aside, "cpu"], [aside.subarray(1), "abacus"]],
  "Adapter.begin": [async (...given) => (await core.Adapter.create(card, weights, "{}", "cpu")).begin(...given), [unsure, "[]", undefined, undefined], [json(followed(frames)), "[[3, [20, 80]]]", "{}", -1]],
  "Adapter.add": [async (picture, time) => (await adapted({ picture, time }), "added"), [frames[1].picture, 1], [new Uint8Array([1, 2, 3]), 0.25]],
  "Adapter.finish": [(name) => adapter.finish(name), ["ball"], ["a/ball"]],
  "FineTuner.addClip": [clipAdded, [line("one"), true], [line("other"), false]],
};

/** What is declared, with how many parameters each; what has none cannot lose one. */
function declared() {
  const found = {};
  const parameters = (list) => list.split(/,\s*(?=\w+\??: )/).filter(Boolean).length;
  for (const [, name, list] of TYPES.matchAll(/^export function (\w+)\(([^)]*)\)/gm)) found[name] = parameters(list);
  for (const [, name, body] of TYPES.matchAll(/^export class (\w+) \{([\s\S]*?)^\}/gm)) {
    for (const [, method, list] of body.matchAll(/^ {4}(?:static )?(\w+)\(([^)]*)\)/gm)) found[`${name}.${method}`] = parameters(list);
  }
  return Object.fromEntries(Object.entries(found).filter(([, count]) => count > 0));
}

test("each parameter of each function and method is looked at", () => {
  // The glue's own way to start.
  const { initSync, default: _, ...all } = declared();
  assert.deepEqual(Object.fromEntries(Object.entries(CASES).map(([name, [, given]]) => [name, given.length]).sort()), Object.fromEntries(Object.entries(all).sort()));
  for (const [name, [, given, others]] of Object.entries(CASES)) assert.equal(others.length, given.length, name);
});

for (const [name, given] of Object.entries(CASES)) test(name, () => each(name, ...given));

/** Options by the name of their declaration: a call, what it is given, and other values. */
const OPTIONS = {
  Wanted: [
    (options) => localiser.localise(seen[0], camera, options),
    { ballRadius: 0.2 },
    {
      heatmap: true,
      depthMap: true,
      ballRadius: 0.4,
      region: { left: 0, top: 0, width: 40, height: 40 },
      scene: { ...floor, bounds: { low: [-900, -900, 800], high: [900, 900, 900] } },
      candidates: 3,
      cameraSigma: [away(samples[0].camera)],
      truth: [0, 0, 0],
    },
  ],
  Known: [
    tracked,
    known,
    {
      camera: { ...filming, width: 400 },
      scene: { ...known.scene, gravity: "down" },
      cameraSigma: [away(filming)],
      cameraAssumed: "maybe",
      hits: -1,
      seeds: [[20, [5, 5]]],
      timesKnown: "maybe",
    },
  ],
  CameraToAssume: [
    core.assumedCamera,
    { width: 400, height: 300 },
    { width: 440, height: 330, focal35mm: 50, heightAboveGround: 1, video: true },
  ],
  DrawnCircle: [
    (circle) => core.ballAt(json(filming), circle, 0.1, "[]"),
    { centre: [80, 60], radiusPx: 12 },
    { centre: [81, 60], radiusPx: 14, sigmaPx: 2, picture: { width: 320, height: 240 } },
  ],
  FineTuneOptions: [
    async (options) => ofTuner(await core.FineTuner.create(card, weights, json(options), "cpu")),
    {},
    { steps: 7, batch: 0, crop: 33, learningRate: -1, supervision: "guesswork", seed: -1 },
  ],
  AdaptOptions: [
    async (options) => ofAdapter(await core.Adapter.create(card, weights, json(options), "cpu")),
    {},
    { steps: 7, learningRate: -1, seed: -1 },
  ],
};

for (const [name, [call, plain, others]] of Object.entries(OPTIONS)) {
  test(`each field of ${name}`, async () => {
    const [, body] = TYPES.match(new RegExp(`export interface ${name} \\{([\\s\\S]*?)\\n\\}`));
    const fields = [...body.matchAll(/^ {4}(\w+)\??:/gm)].map(([, field]) => field);
    assert.deepEqual(Object.keys(others).sort(), fields.sort());
    const before = await outcome(call, [plain]);
    for (const [field, other] of Object.entries(others)) {
      assert.notEqual(await outcome(call, [{ ...plain, [field]: other }]), before, `\`${field}\` has no effect`);
    }
  });
}
