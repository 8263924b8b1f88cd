/** A Worker of the user's that serves several of the package's objects at once. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { pictureOf, samples } from "./support/demo.js";
import { serve } from "./support/server.js";

const complaints = [];
const given = { camera: samples[2].camera, base64: pictureOf(samples[2]).toString("base64") };
let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}harness.html`, complaints);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("each object keeps its own model: localisers that are made at once, a fine-tuner, a toolbox", async () => {
  const { alone, shared } = await page.evaluate(async ({ camera, base64 }) => {
    const { FineTuner, Localiser, Toolbox } = window.gravisight;
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const models = ["models/sd-l.json", "models/sd-s.json", "models/sd-m.json"];
    const found = async (localisers) => {
      const worlds = await Promise.all([...localisers, ...localisers].map((localiser) => localiser.localise(bytes, { camera })));
      for (const localiser of localisers) localiser.dispose();
      return worlds.map(({ world }) => world);
    };
    const alone = await found(await Promise.all(models.map((model) => Localiser.create({ model }))));
    const worker = window.startWorker();
    const [tools, tuner, ...localisers] = await Promise.all([
      Toolbox.create({ worker }),
      FineTuner.create({ model: models[1], worker }),
      ...models.map((model) => Localiser.create({ model, worker })),
    ]);
    const courts = await tools.courts();
    const tuned = await tuner.localise(bytes, { camera });
    const shared = { worlds: await found(localisers), tuned: tuned.world, cards: localisers.map(({ card }) => card.name), courts: courts.length };
    worker.terminate();
    return { alone, shared };
  }, given);
  assert.notDeepEqual(alone[0], alone[1]);
  assert.deepEqual(shared.worlds, alone);
  assert.deepEqual(shared.cards, ["sd-l", "sd-s", "sd-m"]);
  assert.ok(Math.hypot(...shared.tuned.map((value, axis) => value - alone[1][axis])) < 1e-3, "the fine-tuner starts from its own model");
  assert.ok(shared.courts > 3);
});

test("an error of the user's own code in a shared Worker stays the user's, and stops nothing", async () => {
  const { world, seen } = await page.evaluate(async ({ camera, base64 }) => {
    const { Localiser } = window.gravisight;
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const worker = window.startWorker();
    const seen = [];
    worker.addEventListener("error", (event) => {
      // The user's own handler: nobody has handled it before.
      seen.push([event.message, event.defaultPrevented]);
      event.preventDefault();
    });
    const localiser = await Localiser.create({ worker, model: "models/sd-l.json" });
    const under_way = localiser.localise(bytes, { camera });
    worker.postMessage({ throw: "mine" });
    await under_way;
    await new Promise((resolve) => setTimeout(resolve, 200));
    const { world } = await localiser.localise(bytes, { camera });
    worker.terminate();
    return { world, seen };
  }, given);
  assert.equal(world.length, 3);
  assert.equal(seen.length, 1);
  assert.match(seen[0][0], /mine/);
  assert.equal(seen[0][1], false);
});

test("two trackers whose frames come in turns each follow their own ball", { timeout: 120_000 }, async () => {
  const tracks = await page.evaluate(async () => {
    const { Toolbox, VideoTracker } = window.gravisight;
    const worker = window.startWorker();
    const toolbox = await Toolbox.create({ worker });
    const simulators = [await toolbox.simulator({ environment: 1, camera: 1 }), await toolbox.simulator({ environment: 2, camera: 4 })];
    const clips = [await simulators[0].clip(2024, 3), await simulators[1].clip(2024, 1)];
    const trackers = await Promise.all([VideoTracker.create({ worker }), VideoTracker.create({ worker })]);
    for (let frame = 0; frame < 40; frame++) {
      const added = trackers.map(async (tracker, which) => {
        const { t, world } = clips[which].frames[frame];
        await tracker.add(await simulators[which].picture(world), 1000 * t);
      });
      await Promise.all(added);
    }
    const found = await Promise.all(trackers.map((tracker) => tracker.track()));
    worker.terminate();
    return found.map(({ frames }, which) => frames.map(({ image }, frame) => ({ found: image, truth: clips[which].frames[frame].image, visible: clips[which].frames[frame].visible })));
  });
  for (const [which, track] of tracks.entries()) {
    assert.equal(track.length, 40);
    const near = track.filter(({ found, truth }) => found && Math.hypot(found[0] - truth[0], found[1] - truth[1]) < 1);
    const visible = track.filter((frame) => frame.visible);
    assert.ok(near.length >= 0.9 * visible.length, `tracker ${which}: ${near.length} of ${visible.length} frames`);
  }
});

test("what disposes of one object leaves the others, the Worker and its other work alone", async () => {
  const outcome = await page.evaluate(async ({ camera, base64 }) => {
    const { Localiser, Toolbox } = window.gravisight;
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const worker = window.startWorker();
    const [first, second] = await Promise.all(["models/sd-l.json", "models/sd-s.json"].map((model) => Localiser.create({ model, worker })));
    const codeOf = (promise) => promise.then(() => "served", ({ code }) => code);
    const running = [first, first, second, second].map((localiser) => codeOf(localiser.localise(bytes, { camera })));
    await new Promise((resolve) => setTimeout(resolve));
    first.dispose();
    first.dispose();
    const codes = await Promise.all(running);
    codes.push(await codeOf(first.localise(bytes, { camera })), await codeOf(second.localise(bytes, { camera })));
    // One whose loading is aborted goes alone, too.
    const controller = new AbortController();
    const aborted = await Localiser.create({ model: "models/sd-m.json", worker, signal: controller.signal, onProgress: () => controller.abort(new Error("mine")) }).catch(({ message }) => message);
    codes.push(aborted, await codeOf(second.localise(bytes, { camera })));
    second.dispose();
    // The last one is gone: the Worker is still the user's.
    codes.push(await codeOf(Toolbox.create({ worker })));
    const answer = new Promise((resolve) => worker.addEventListener("message", ({ data }) => data.memories && resolve("answered")));
    worker.postMessage("memories");
    codes.push(await answer);
    worker.terminate();
    return codes;
  }, given);
  assert.deepEqual(outcome, ["disposed", "disposed", "served", "served", "disposed", "served", "mine", "served", "served", "answered"]);
});

test("the core is started once a Worker, and gives the memory of what is disposed of to what comes next", async () => {
  const sizes = await page.evaluate(async ({ camera, base64 }) => {
    const { Localiser } = window.gravisight;
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const worker = window.startWorker();
    const sizes = [];
    for (let round = 0; round < 24; round++) {
      const localisers = await Promise.all(["models/sd-l.json", "models/sd-s.json"].map((model) => Localiser.create({ model, worker })));
      for (const localiser of localisers) await localiser.localise(bytes, { camera });
      for (const localiser of localisers) localiser.dispose();
      const heard = new Promise((resolve) => worker.addEventListener("message", ({ data }) => data.memories && resolve(data.memories)));
      worker.postMessage("memories");
      sizes.push(await heard);
    }
    worker.terminate();
    return sizes;
  }, given);
  assert.ok(sizes.every((memories) => memories.length === 1), `${JSON.stringify(sizes)}`);
  // The allocator takes another page now and then; 23 rounds that kept the weights of one model would take 33 MB.
  assert.ok(sizes.at(-1)[0] <= sizes[0][0] + 4e6, `${sizes}`);
});

test("nothing was reported to the console", () => {
  assert.deepEqual(complaints, []);
});
