/**
 * Spoilt inputs through the CPU build in Node.js: `node fuzz.mjs COUNT [FOLDER…]`. What the fuzz targets began with (fuzz/corpus) and what they have found
 * since (the folders) is changed at random places and given to what reads it. Whatever happens must be a result or a `GravisightError`; exit 1 else.
 */
import { createHash } from "node:crypto";
import { existsSync, readdirSync, readFileSync, statSync } from "node:fs";

const [count, ...folders] = process.argv.slice(2);
const root = new URL("../../../", import.meta.url);
const read = (path) => readFileSync(new URL(path, root));
const core = await import(new URL("pkg/wasm/cpu/gravisight.js", root));
await core.default({ module_or_path: read("pkg/wasm/cpu/gravisight_bg.wasm") });

/** Weyl sequence through a mixer (splitmix64's, in 32 bits): the same inputs each time. */
let state = 1;
function random() {
  state = (state + 0x9e3779b9) | 0;
  let mixed = Math.imul(state ^ (state >>> 16), 0x21f0aaad);
  mixed = Math.imul(mixed ^ (mixed >>> 15), 0x735a2d97);
  return ((mixed ^ (mixed >>> 15)) >>> 0) / 2 ** 32;
}
const below = (limit) => Math.floor(random() * limit);
const one = (list) => list[below(list.length)];

/** Files of folders. */
function inputs(all) {
  return all.filter(existsSync).flatMap((folder) => readdirSync(folder).map((name) => `${folder}/${name}`)).filter((path) => statSync(path).size < 65536).map((path) => readFileSync(path));
}
/** What is whole, mostly, and what the fuzz targets made of it, mostly not. */
const corpus = Object.fromEntries(
  ["picture", "text", "weights"].map((kind) => {
    const whole = inputs([new URL(`fuzz/corpus/${kind}`, root).pathname]);
    const found = inputs(folders.map((folder) => `${folder}/${kind}`));
    return [kind, () => one(found.length && random() < 0.3 ? found : whole)];
  }),
);

const WORDS = ["1e308", "-1", "0", "NaN", "null", "[]", "{}", '""', "1e-320", "99999999999999999999", "true", "\u0000", "é", ","].map((word) => Buffer.from(word));
/** A few bytes changed, left out, put in, or the rest of another input. */
function spoilt(kind) {
  let bytes = corpus[kind]();
  for (let times = below(4); times > 0; times--) {
    const at = below(bytes.length + 1);
    const [before, after] = [bytes.subarray(0, at), bytes.subarray(at)];
    bytes = one([
      () => Buffer.concat([before, Buffer.from([below(256)]), after.subarray(1)]),
      () => Buffer.concat([before, after.subarray(below(16))]),
      () => Buffer.concat([before, one(WORDS), after.subarray(below(8))]),
      () => Buffer.concat([before, Buffer.from(Array.from({ length: below(16) }, () => below(256))), after]),
      () => Buffer.concat([before, corpus[kind]().subarray(below(64))]),
      () => before,
    ])();
  }
  return bytes;
}

const card = read("models/sd-l.json").toString();
const any = read("models/any.json").toString();
const weights = read("models/sd-l.safetensors");
const localiser = await core.Localiser.create(card, weights, "cpu");
const cameraOf = (width, height) =>
  JSON.stringify({ width, height, intrinsic: [[80, 0, (width - 1) / 2], [0, 80, (height - 1) / 2], [0, 0, 1]], camera_from_world: [[1, 0, 0, 0], [0, 0, -1, 1.6], [0, 1, 0, 4], [0, 0, 0, 1]] });
const sample = cameraOf(64, 64);
/** Of the shapes of the pictures. */
const cameras = [cameraOf(60, 40), cameraOf(40, 60), cameraOf(24, 20)];
const places = core.scenes().map((name) => JSON.stringify(core.scene(name)));

/** Of any size, the usual ones more often. */
const number = () => (random() < 0.8 ? 20 * random() - 10 : (random() - 0.5) * 10 ** below(300));
const numbers = (length) => Array.from({ length }, number);
const rising = (length) => numbers(length).map(Math.abs).sort((a, b) => a - b);

/** Weights with a card that says they are its own: else the checksum is all that is tried. */
async function vouchedFor(bytes) {
  const own = any.replace(JSON.parse(any).sha256, createHash("sha256").update(bytes).digest("hex"));
  (await core.Localiser.create(own, bytes, "cpu")).free();
}

/** What is tried, and how often of a hundred. */
const targets = [
  [35, () => localiser.localise(spoilt("picture"), one(cameras))],
  [15, () => core.project(spoilt("text").toString().slice(1), numbers(6))],
  [10, () => core.forecast(spoilt("text").toString().slice(1), numbers(6), rising(4))],
  [10, () => core.calibrate(spoilt("text").toString().slice(1), [])],
  [10, () => vouchedFor(spoilt("weights"))],
  [5, () => core.Localiser.create(spoilt("text").toString().slice(1), weights, "cpu").then((made) => made.free())],
  [10, () => core.forecast(one(places), numbers(6), rising(8))],
  [5, () => core.fitTrack(JSON.stringify(rising(below(12)).map((time) => ({ time, image: random() < 0.9 ? [64 * random(), 64 * random()] : numbers(2), ...(random() < 0.1 && { radius: numbers(2) }) }))), sample, one(places), undefined, [], "[]")],
];
const lots = targets.flatMap(([share, target], index) => Array(share).fill({ index, target }));

const outcomes = targets.map(() => ({ results: 0, refusals: 0 }));
let slowest = 1000;
const start = performance.now();
for (let done = 1; done <= Number(count); done++) {
  const { index, target } = one(lots);
  const before = state;
  const began = performance.now();
  if (process.env.VERBOSE) console.log(done, index, before);
  try {
    await target();
    outcomes[index].results++;
  } catch (thrown) {
    if (thrown?.name !== "GravisightError" || thrown.code === "internal" || core.lastPanic()) {
      console.error(`input ${done} (target ${index}, random state ${before}): ${thrown?.stack ?? thrown} ${core.lastPanic()}`);
      process.exit(1);
    }
    outcomes[index].refusals++;
  }
  const took = performance.now() - began;
  if (took > slowest) {
    slowest = took;
    console.log(`input ${done} (target ${index}, random state ${before}) takes ${took.toFixed(0)} ms`);
  }
  if (done % 10_000 === 0) console.log(`${done} inputs, ${((performance.now() - start) / 1000).toFixed(0)} s`);
}
console.log(`${count} inputs through the wasm build, no trap:`, outcomes.map(({ results, refusals }) => `${results} read, ${refusals} refused`).join("; "));
