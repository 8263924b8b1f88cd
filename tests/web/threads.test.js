/** The core on several threads: on a page that is cross-origin isolated, and in Node.js. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { Localiser } from "gravisight";
import { launch, open } from "./support/browser.js";
import { without } from "./support/builds.js";
import { pictureOf, samples } from "./support/demo.js";
import { serveFolder } from "./support/server.js";
import { STUB_MODEL, writeStubBuilds } from "./support/stub-builds.js";

const pkg = fileURLToPath(new URL("../../pkg", import.meta.url));
const skip = without("cpu-threads");
const complaints = [];
let browser;
const pages = {};
const servers = [];

before(async () => {
  const folder = mkdtempSync(join(tmpdir(), "gravisight-threads-"));
  writeFileSync(join(folder, "index.html"), '<!doctype html><link rel="icon" href="data:,"><title>threads</title>');
  writeFileSync(join(folder, "worker.js"), 'import "/pkg/dist/worker.js";');
  symlinkSync(pkg, join(folder, "pkg"));
  writeStubBuilds(join(folder, "stub"));
  browser = await launch({ webgpu: false });
  for (const isolated of [true, false]) {
    const server = await serveFolder(folder, "", isolated);
    servers.push(server);
    pages[isolated] = await open(browser, `${server.url}index.html`, complaints);
    await pages[isolated].evaluate(async () => (window.gravisight = await import("/pkg/dist/index.js")));
  }
});

after(async () => {
  await browser?.close();
  for (const server of servers) server.close();
});

/** Where the ball is in the first sample, and on what it was found. */
async function located(page, threads) {
  return page.evaluate(
    async ([bytes, camera, threads]) => {
      const localiser = await window.gravisight.Localiser.create({ camera, ball: { radius: 0.2 }, threads });
      const { world } = await localiser.localise(new Uint8Array(bytes));
      const { name } = localiser.device;
      localiser.dispose();
      return { world, name };
    },
    [[...pictureOf(samples[0])], samples[0].camera, threads],
  );
}

test("two threads find what one finds, on a page that is cross-origin isolated", { skip }, async () => {
  assert.equal(await pages.true.evaluate(() => crossOriginIsolated), true);
  const one = await located(pages.true, 1);
  const two = await located(pages.true, 2);
  assert.match(one.name, /one thread/);
  assert.match(two.name, /relaxed SIMD, 2 threads/);
  assert.deepEqual(two.world, one.world);
  assert.match((await located(pages.true, "auto")).name, /\d threads|one thread/);
});

test("on any other page it is one thread, and nothing is said", async () => {
  assert.match((await located(pages.false, "auto")).name, /one thread/);
  assert.match((await located(pages.false, 4)).name, /one thread/);
});

test("the calling thread, which nobody could tell of a trap, has no others", async () => {
  const name = await pages.true.evaluate(async (camera) => {
    const localiser = await window.gravisight.Localiser.create({ camera, ball: { radius: 0.2 }, threads: 2, worker: false });
    const { name } = localiser.device;
    localiser.dispose();
    return name;
  }, samples[0].camera);
  assert.match(name, /one thread/);
});

test("the files to preload are those that will be fetched", { skip: skip || without("cpu-relaxed") }, async () => {
  const files = (page, threads) => page.evaluate((threads) => window.gravisight.coreFiles("cpu", { threads }), threads);
  assert.match((await files(pages.true, 2)).join(), /cpu-threads\/gravisight_bg\.wasm/);
  assert.match((await files(pages.true, 1)).join(), /cpu-relaxed\/gravisight_bg\.wasm/);
  assert.match((await files(pages.false, 2)).join(), /cpu-relaxed\/gravisight_bg\.wasm/);
});

test("a thread that traps ends what waits for it, in a Worker of its own and in one of the user's", async () => {
  const before = complaints.length;
  const failed = await pages.true.evaluate(async (card) => {
    const model = { card, weights: new Uint8Array(1) };
    const thrown = [];
    for (const worker of [undefined, new Worker("/worker.js", { type: "module" })]) {
      const creating = window.gravisight.Localiser.create({ wasm: "/stub/", model, threads: 2, cache: false, ...(worker && { worker }) });
      const late = new Promise((resolve) => setTimeout(() => resolve({ code: "nothing was heard" }), 20_000));
      const { code, message } = await Promise.race([creating.catch((each) => each), late]);
      thrown.push({ code, message });
      worker?.terminate();
    }
    return thrown;
  }, STUB_MODEL.card);
  for (const { code, message } of failed) {
    assert.equal(code, "internal", message);
    assert.match(message, /thread.*out of memory/);
  }
  // The browser's own report of the trap.
  complaints.push(...complaints.splice(before).filter((complaint) => !complaint.includes("unreachable")));
});

test("in Node.js too, and a program ends all the same", { skip }, () => {
  const script = `
    import { readFileSync } from "node:fs";
    import { Localiser } from ${JSON.stringify(new URL("../../pkg/dist/index.js", import.meta.url).href)};
    const localiser = await Localiser.create({ threads: 2, ball: { radius: 0.2 }, camera: JSON.parse(process.argv[1]) });
    const { world } = await localiser.localise(readFileSync(process.argv[2]));
    console.log(JSON.stringify({ world, name: localiser.device.name }));`;
  // Node.js 20 has relaxed SIMD behind this switch, later ones always.
  const flags = process.versions.node.startsWith("20.") ? ["--experimental-wasm-relaxed-simd"] : [];
  const picture = fileURLToPath(new URL(`../../web/public/samples/${samples[0].file}`, import.meta.url));
  const said = execFileSync(process.execPath, [...flags, "--input-type=module", "-e", script, JSON.stringify(samples[0].camera), picture], { encoding: "utf8" });
  const { name, world } = JSON.parse(said);
  assert.match(name, /relaxed SIMD, 2 threads/);
  assert.equal(world.length, 3);
});

test("what is no number of threads is refused", async () => {
  for (const threads of [0, 1.5, "many"]) {
    await assert.rejects(Localiser.create({ camera: samples[0].camera, threads }), { code: "threads" });
  }
});

test("nothing was reported to the console", () => assert.deepEqual(complaints, []));
