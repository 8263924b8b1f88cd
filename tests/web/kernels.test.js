/** The CPU builds themselves, without the package around them. */
import assert from "node:assert/strict";
import { createReadStream } from "node:fs";
import { createServer } from "node:http";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { launch } from "./support/browser.js";
import { samples } from "./support/demo.js";

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

test("both builds find the ball at the same place, and a thousand pictures take no more memory than the first", async () => {
  const found = {};
  for (const build of ["cpu", "cpu-relaxed"]) {
    const { device, world, before, after } = await page.evaluate(thousandPictures, { build, camera: JSON.stringify(samples[0].camera) });
    assert.equal(after, before, `${build}: ${before} bytes after 20 pictures, ${after} after 1,020`);
    assert.match(device, build === "cpu" ? /SIMD128/ : /relaxed SIMD/);
    found[build] = world;
  }
  found.cpu.forEach((value, axis) => assert.ok(Math.abs(value - found["cpu-relaxed"][axis]) < 1e-3, JSON.stringify(found)));
});

/** In the page. */
async function thousandPictures({ build, camera }) {
  const module = await import(`/pkg/wasm/${build}/gravisight.js`);
  const { memory } = await module.default({ module_or_path: `/pkg/wasm/${build}/gravisight_bg.wasm` });
  const card = await (await fetch("/models/sd-l.json")).text();
  const weights = new Uint8Array(await (await fetch("/models/sd-l.safetensors")).arrayBuffer());
  const localiser = await module.Localiser.create(card, weights, "cpu");
  const rgba = new Uint8Array(224 * 224 * 4).map((_, index) => (index * 7919) % 251);
  const run = () => localiser.localiseRgba(rgba, 224, 224, camera, { maps: false });
  let result;
  for (let picture = 0; picture < 20; picture++) result = await run();
  const before = memory.buffer.byteLength;
  for (let picture = 0; picture < 1000; picture++) result = await run();
  return { device: localiser.deviceName, world: result.world, before, after: memory.buffer.byteLength };
}
