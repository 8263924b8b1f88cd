/** The package in Node.js, from its files: no browser, no server. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { FineTuner, GravisightError, isCached, Localiser, Toolbox } from "gravisight";
import { pictureOf, samples } from "./support/demo.js";

const model = new URL("../../models/sd-l.json", import.meta.url);
const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));

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

test("two toolboxes that share a Worker each get their own answers", async () => {
  // It answers one message after the other, as the package's own does; both hear each answer.
  class Shared extends EventTarget {
    #last = Promise.resolve();
    postMessage({ id, request }) {
      this.#last = this.#last.then(() => this.dispatchEvent(new MessageEvent("message", { data: { type: "done", id, answer: request.name } })));
    }
    terminate() {}
  }
  const worker = new Shared();
  const [one, other] = [await Toolbox.create({ worker }), await Toolbox.create({ worker })];
  assert.deepEqual(await Promise.all([one.court("tennis"), other.court("badminton")]), ["tennis", "badminton"]);
});

test("a fine-tuner refuses senseless options by name", async () => {
  await assert.rejects(FineTuner.create({ model, crop: 33 }), /crop/);
  await assert.rejects(FineTuner.create({ model, steps: NaN }), { code: "options-not-finite" });
});
