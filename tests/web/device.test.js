/** Which device is taken, and that both give the same maps. */
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { without } from "./support/builds.js";
import { located, pictureOf, samples } from "./support/demo.js";
import { losesDevice } from "./support/in-page.js";
import { serve } from "./support/server.js";

const here = (path) => new URL(path, import.meta.url);
const skip = without("webgpu");
const SIZE = 64;
const TINY_CAMERA = {
  width: SIZE,
  height: SIZE,
  intrinsic: [[80, 0, 31.5], [0, 80, 31.5], [0, 0, 1]],
  camera_from_world: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
};
const complaints = [];
let server;

before(async () => {
  server = await serve();
});
after(() => server?.close());

test("auto without an adapter takes the CPU and says why", async () => {
  await inBrowser({ webgpu: false }, "?device=auto", async (page) => {
    await located(page);
    const device = await page.getByTestId("device").textContent();
    assert.match(device, /CPU/);
    assert.match(device, /auto: .*no WebGPU/);
    assert.ok(await page.getByTestId("device-auto").isChecked());
  });
});

test("webgpu without an adapter is refused in words, and the CPU can be chosen", async () => {
  await inBrowser({ webgpu: false }, "?device=webgpu", async (page) => {
    await page.waitForFunction(() => document.querySelector('[data-part="alert"]').textContent !== "");
    assert.match(await page.getByTestId("alert").textContent(), /WebGPU cannot be used/);
    await page.getByTestId("device-cpu").check();
    await located(page);
    assert.equal(await page.getByTestId("alert").textContent(), "");
  });
});

test("without the WebGPU build, auto takes the CPU, webgpu says what is missing, and the page stays on the CPU", async () => {
  await inBrowser({ webgpu: true }, "about:blank", async (page) => {
    for (const asset of webGpuGlue()) await page.route(`**/${asset}`, (route) => route.fulfill({ status: 404 }));
    await page.goto(`${server.url}?device=auto`);
    await located(page);
    assert.match(await page.getByTestId("device").textContent(), /CPU.*auto: WebGPU failed: .*build was not found/);
    await page.getByTestId("device-webgpu").check();
    await page.waitForFunction(() => document.querySelector('[data-part="alert"]').textContent !== "");
    assert.match(await page.getByTestId("alert").textContent(), /WebGPU build was not found/);
    assert.ok(await page.getByTestId("device-auto").isChecked());
    await located(page);
  });
  // The browser itself reports the file that was not there.
  const missing = complaints.splice(0).filter((complaint) => !complaint.includes("404"));
  assert.deepEqual(missing, []);
});

test("the WebGPU build gives the CPU's heatmap and depth", { skip, timeout: 300_000 }, async () => {
  await inBrowser({ webgpu: true }, "harness.html", async (page) => {
    await offerTiny(page);
    const { cpu, webgpu, kind } = await page.evaluate(mapsOfBoth, "golden/tiny.json");
    assert.equal(kind, "webgpu");
    for (const map of ["heatmap", "depth"]) {
      assert.equal(webgpu[map].length, cpu[map].length);
      const worst = Math.max(...cpu[map].map((value, i) => Math.abs(value - webgpu[map][i])));
      // NaN fails this comparison, as it must.
      assert.ok(worst <= 1e-3, `${map}: the largest difference is ${worst}`);
    }
  });
});

// A GPU in software stands in for one.
for (const name of ["any", "sd-l"]) {
  test(`${name} finds the ball on WebGPU where it does on the CPU, to the millimetre`, { skip, timeout: 900_000 }, async () => {
    await inBrowser({ webgpu: true }, "harness.html", async (page) => {
      const given = { model: `models/${name}.json`, camera: samples[0].camera, base64: pictureOf(samples[0]).toString("base64") };
      const { cpu, webgpu } = await page.evaluate(localiseOnBoth, given);
      assert.deepEqual([cpu.device.kind, webgpu.device.kind], ["cpu", "webgpu"]);
      const off = Math.hypot(...cpu.world.map((value, axis) => value - webgpu.world[axis]));
      assert.ok(off < 1e-3, `${1000 * off} mm apart: ${cpu.world} and ${webgpu.world}`);
      assert.ok(Math.abs(cpu.confidence - webgpu.confidence) < 1e-3, `${cpu.confidence} and ${webgpu.confidence}`);
      const { adapter, name: words } = webgpu.device;
      assert.match(words, /^WebGPU \(.*swiftshader.*\)$/i);
      assert.equal(adapter.architecture, "swiftshader");
      assert.ok(adapter.limits.maxBufferSize >= 2 ** 28 && adapter.limits.maxComputeInvocationsPerWorkgroup >= 128, JSON.stringify(adapter));
      assert.equal(cpu.device.adapter, undefined);
    });
  });
}

test("auto measures both devices once, keeps the answer, and takes the faster one", { skip, timeout: 900_000 }, async () => {
  await inBrowser({ webgpu: true }, "harness.html", async (page) => {
    await offerTiny(page);
    const auto = (options) => page.evaluate(createAuto, { model: "golden/tiny.json", ...options });
    const first = await auto();
    assert.equal(first.device.kind, "cpu", first.device.reason);
    assert.match(first.device.reason, /^auto: the CPU is faster: [\d.]+ ms per picture, WebGPU [\d.e+]+ ms$/);
    assert.equal(first.measured, 6);

    const second = await auto();
    assert.equal(second.measured, 0);
    assert.equal(second.device.reason, `${first.device.reason} (measured on ${new Date().toISOString().slice(0, 10)})`);

    // On a machine where WebGPU won.
    assert.equal(await page.evaluate(changeTimes, { times: { webgpu: 0.5 } }), 1);
    const third = await auto();
    assert.deepEqual([third.device.kind, third.measured], ["webgpu", 0]);
    assert.match(third.device.reason, /^auto: WebGPU is faster: 0\.500 ms per picture, the CPU .* \(measured on /);

    // Kept by another version of the package, of another adapter, or not at all.
    for (const change of [{ key: { from: /"\d+\.\d+\.\d+"/.source, to: '"0.0.1"' } }, { key: { from: "swiftshader", to: "ampere" } }, { times: { webgpu: 0 } }]) {
      assert.ok((await page.evaluate(changeTimes, change)) > 0);
      const again = await auto();
      assert.deepEqual([again.device.kind, again.measured], ["cpu", 6], JSON.stringify(change));
    }
    const uncached = await auto({ cache: false });
    assert.equal(uncached.measured, 6);
  });
});

test("a step of fine-tuning on WebGPU is the CPU's, and so are the weights that are exported", { skip, timeout: 900_000 }, async () => {
  await inBrowser({ webgpu: true }, "harness.html", async (page) => {
    await offerTiny(page);
    for (const [model, steps] of [["golden/tiny.json", 2], ["models/sd-s.json", 1]]) {
      const { cpu, webgpu } = await page.evaluate(tuneOnBoth, { model, steps });
      assert.deepEqual([cpu.kind, webgpu.kind], ["cpu", "webgpu"]);
      assert.equal(webgpu.losses.length, steps);
      webgpu.losses.forEach((loss, index) => assert.ok(Math.abs(loss - cpu.losses[index]) < 1e-4 * loss, `${model}: ${webgpu.losses} and ${cpu.losses}`));
      webgpu.world.forEach((value, axis) => assert.ok(Math.abs(value - cpu.world[axis]) < 5e-3, `${model}: ${webgpu.world} and ${cpu.world}`));
    }
  });
});

test("a WebGPU device that is lost while in use hands over to the CPU, which says so", { skip, timeout: 300_000 }, async () => {
  await inBrowser({ webgpu: true }, "harness.html", async (page) => {
    await offerTiny(page);
    const [worker] = readdirSync(here("../../web/dist/assets/")).filter((name) => /^worker-.*\.js$/.test(name));
    const losing = { contentType: "text/javascript", body: `import "./${worker}";(${losesDevice})();` };
    // As the page's own server says: the page is isolated.
    const headers = { "Cross-Origin-Embedder-Policy": "require-corp" };
    await page.route("**/assets/losing.js", (route) => route.fulfill({ ...losing, headers }));
    const { before, after, again, kind } = await page.evaluate(loseDevice, "golden/tiny.json");
    assert.equal(before.device.kind, "webgpu");
    assert.equal(after.device.kind, "cpu");
    assert.match(after.device.reason, /WebGPU failed while in use/);
    assert.equal(kind, "cpu", "the localiser's own device");
    assert.deepEqual(again.device, after.device);
    for (const { world } of [after, again]) {
      world.forEach((value, axis) => assert.ok(Math.abs(value - before.world[axis]) < 1e-3, `${world} is not ${before.world}`));
    }
  });
  // The core's own report of what the lost device made of it.
  complaints.splice(0);
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});

async function inBrowser(options, path, body) {
  const browser = await launch(options);
  try {
    await body(await open(browser, path === "about:blank" ? path : server.url + path, complaints));
  } finally {
    await browser.close();
  }
}

/** What the page's build calls the WebGPU build's glue; nothing where it was built without. */
function webGpuGlue() {
  if (skip) return [];
  const content = readFileSync(here("../../pkg/wasm/webgpu/gravisight.js"));
  const assets = here("../../web/dist/assets/");
  const isGlue = (name) => name.endsWith(".js") && readFileSync(new URL(name, assets)).equals(content);
  const found = readdirSync(assets).filter(isGlue);
  assert.equal(found.length, 1, "web/dist is older than pkg/wasm/webgpu: run `npm run build`");
  return found;
}

/** A network so small that software can stand in for a GPU. */
async function offerTiny(page) {
  for (const [name, contentType] of [["tiny.json", "application/json"], ["tiny.safetensors", "application/octet-stream"]]) {
    const body = readFileSync(here(`../golden/${name}`));
    await page.route(`**/golden/${name}`, (route) => route.fulfill({ contentType, body }));
  }
  await page.addScriptTag({ content: `window.tiny = ${JSON.stringify({ camera: TINY_CAMERA, size: SIZE })}` });
}

// The functions below run in the page.

async function loseDevice(model) {
  const { camera, size } = window.tiny;
  const picture = new ImageData(size, size);
  picture.data.fill(200);
  const worker = new Worker("assets/losing.js", { type: "module" });
  const localiser = await window.gravisight.Localiser.create({ model, camera, device: "webgpu", worker });
  const before = await localiser.localise(picture);
  worker.postMessage("lose");
  const after = await localiser.localise(picture);
  const again = await localiser.localise(picture);
  const { kind } = localiser.device;
  localiser.dispose();
  return { before, after, again, kind };
}

async function localiseOnBoth({ model, camera, base64 }) {
  const picture = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const found = {};
  for (const device of ["cpu", "webgpu"]) {
    const localiser = await window.gravisight.Localiser.create({ model, camera, device, ball: { radius: 0.2 } });
    found[device] = await localiser.localise(picture);
    localiser.dispose();
  }
  return found;
}

async function createAuto(options) {
  let measured = 0;
  const onProgress = ({ stage }) => (measured += stage === "measuring");
  const localiser = await window.gravisight.Localiser.create({ ...options, device: "auto", onProgress });
  const { device } = localiser;
  localiser.dispose();
  return { device, measured };
}

/** Changes the times that are kept, or under what; returns how many there are. */
async function changeTimes({ times, key }) {
  const cache = await caches.open("gravisight");
  const kept = (await cache.keys()).filter(({ url }) => decodeURIComponent(url).includes("/times "));
  for (const request of kept) {
    const content = { ...(await (await cache.match(request)).json()), ...times };
    const name = decodeURIComponent(new URL(request.url).pathname.slice(1));
    const changed = key ? name.replace(new RegExp(key.from), key.to) : name;
    await cache.delete(request);
    await cache.put(`https://gravisight.invalid/${encodeURIComponent(changed)}`, new Response(JSON.stringify(content)));
  }
  return kept.length;
}

async function tuneOnBoth({ model, steps }) {
  const { FineTuner, Localiser, Toolbox } = window.gravisight;
  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const { fps, frames } = await simulator.clip(3, 0);
  const drawn = [];
  for (const { t, image, world } of frames.slice(0, 40)) {
    const { data, width, height } = await simulator.picture(world);
    drawn.push({ picture: new ImageData(data, width, height), t, image });
  }
  const made = {};
  for (const device of ["cpu", "webgpu"]) {
    let tuner = await FineTuner.create({ model, device, steps, batch: 2, crop: 32 });
    const give = () => tuner.addClip({ id: "clip", fps, camera: simulator.camera, scene: simulator.scene, frames: drawn });
    await give();
    const losses = [];
    for (let step = 0; step < steps; step++) {
      if (step > 0 && device === "webgpu") {
        const checkpoint = await tuner.checkpoint();
        tuner.dispose();
        tuner = await FineTuner.resume(checkpoint, { device });
        await give();
      }
      await tuner.step(1, { onStep: ({ loss }) => losses.push(loss) });
    }
    const localiser = await Localiser.create({ model: await tuner.export(), camera: simulator.camera });
    const { world } = await localiser.localise(drawn[3].picture);
    made[device] = { kind: tuner.device.kind, losses, world };
    localiser.dispose();
    tuner.dispose();
  }
  toolbox.dispose();
  return made;
}

async function mapsOfBoth(model) {
  const { camera, size } = window.tiny;
  // A smooth picture with every channel in use; any would do.
  const picture = new ImageData(size, size);
  picture.data.forEach((_, i) => {
    const x = (i >> 2) % size;
    const y = (i >> 2) / size;
    picture.data[i] = i % 4 === 3 ? 255 : 127 + 120 * Math.sin(0.11 * x * ((i % 4) + 1) + 0.07 * y);
  });
  const maps = {};
  let kind;
  for (const device of ["cpu", "webgpu"]) {
    const localiser = await window.gravisight.Localiser.create({ model, device });
    const result = await localiser.localise(picture, { camera, heatmap: true, depthMap: true });
    maps[device] = { heatmap: [...result.heatmap.values], depth: [...result.depthMap.values] };
    kind = localiser.device.kind;
    localiser.dispose();
  }
  return { ...maps, kind };
}
