/**
 * The package at length in Chromium: `node soak.mjs [FRAMES] [TIMES]`. FRAMES pictures through one localiser (100,000), TIMES of which are made and disposed
 * of with aborts at random moments (1,000), a WebGPU device lost 50 times, and five tabs at once. Prints memory and times; exit 1 where something grows,
 * fails or differs.
 */
import { readdirSync, readFileSync } from "node:fs";
import { launch, open } from "../support/browser.js";
import { losesDevice } from "../support/in-page.js";
import { serve } from "../support/server.js";

const [frames = 100_000, times = 1000] = process.argv.slice(2).map(Number);
const LOSSES = 50;
const TABS = 5;
/** Megabytes by which memory may grow in the second half: the allocator's pages settle in the first. */
const GROWTH = 2;
const here = (path) => new URL(path, import.meta.url);
const camera = { width: 64, height: 64, intrinsic: [[80, 0, 31.5], [0, 80, 31.5], [0, 0, 1]], camera_from_world: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] };
const complaints = [];
let failed = false;
const check = (isRight, words) => {
  console.log(`${isRight ? "ok" : "FAILED"}: ${words}`);
  failed ||= !isRight;
};

const server = await serve();
const begin = async (webgpu) => {
  const browser = await launch({ webgpu, args: ["--js-flags=--expose-gc"] });
  return { browser, page: await tab(browser) };
};
async function tab(browser) {
  const page = await open(browser, `${server.url}harness.html`, complaints);
  for (const name of ["tiny.json", "tiny.safetensors"]) {
    await page.route(`**/golden/${name}`, (route) => route.fulfill({ contentType: "application/octet-stream", body: readFileSync(here(`../../golden/${name}`)) }));
  }
  return page;
}

/** Memory of the browser's pages that no other process shares, MB. */
async function memory(browser, page) {
  // What was sent to and fro is collected late otherwise.
  await Promise.all([page, ...page.workers()].map((each) => each.evaluate(() => globalThis.gc())));
  await page.waitForTimeout(300);
  const session = await browser.newBrowserCDPSession();
  const { processInfo } = await session.send("SystemInfo.getProcessInfo");
  await session.detach();
  const own = ({ id }) => readFileSync(`/proc/${id}/smaps_rollup`, "utf8").match(/Private_Dirty: +(\d+)/)[1] / 1024;
  return processInfo.filter(({ type }) => type === "renderer").reduce((sum, process) => sum + own(process), 0);
}

/** Runs `part`(how many) ten times in the page, and says what memory and time do. */
async function tenths(what, { browser, page }, all, part) {
  const rows = [];
  for (let tenth = 0; tenth < 10; tenth++) {
    const ms = await part(all / 10);
    rows.push({ ms, megabytes: await memory(browser, page) });
    console.log(`   ${what}, ${((tenth + 1) * all) / 10}: ${ms.toFixed(3)} ms each, ${rows.at(-1).megabytes.toFixed(1)} MB`);
  }
  const middle = (from, to) => rows.slice(from, to).map(({ megabytes }) => megabytes).toSorted((a, b) => a - b)[1];
  const grown = middle(7, 10) - middle(4, 7);
  const slower = 100 * (Math.min(...rows.slice(5).map(({ ms }) => ms)) / Math.min(...rows.slice(0, 5).map(({ ms }) => ms)) - 1);
  check(grown <= GROWTH, `${what}: memory grows by ${grown.toFixed(1)} MB in the second half`);
  console.log(`   ${what}: the second half's fastest tenth is ${slower.toFixed(1)} % slower than the first's`);
}

{
  const begun = await begin(false);
  const { browser, page } = begun;
  await page.evaluate(async (camera) => (window.localiser = await window.gravisight.Localiser.create({ model: "golden/tiny.json", camera, device: "cpu" })), camera);
  await tenths("frames", begun, frames, (count) => page.evaluate(localises, count));
  await page.evaluate(() => window.localiser.dispose());
  await tenths("made and disposed of", begun, times, (count) => page.evaluate(makesAndAborts, { count, camera }));
  const pages = await Promise.all(Array.from({ length: TABS }, () => tab(browser)));
  const found = await Promise.all(pages.map((each) => each.evaluate(worlds, { count: 200, camera })));
  check(new Set(found.map((worlds) => JSON.stringify(worlds))).size === 1, `${TABS} tabs at once find the same 200 positions`);
  await browser.close();
}
{
  const { browser, page } = await begin(true);
  const [worker] = readdirSync(here("../../../web/dist/assets/")).filter((name) => /^worker-.*\.js$/.test(name));
  await page.route("**/assets/losing.js", (route) => route.fulfill({ contentType: "text/javascript", body: `import "./${worker}";(${losesDevice})();` }));
  const kinds = [];
  for (let times = 0; times < LOSSES; times++) {
    kinds.push(await page.evaluate(loses, camera));
    if ((times + 1) % 5 === 0) console.log(`   device lost, ${times + 1}`);
  }
  check(kinds.every((kind) => kind === "webgpu cpu"), `a device lost ${LOSSES} times hands over to the CPU: ${[...new Set(kinds)].join(", ")}`);
  // The core reports what a lost device made of it.
  complaints.splice(0);
  await browser.close();
}
check(complaints.length === 0, `nothing reported to the console ${complaints.slice(0, 3).join("; ")}`);
await server.close();
process.exit(failed ? 1 : 0);

// The functions below run in the page.

async function localises(count) {
  const start = performance.now();
  window.frame ??= 0;
  for (let index = 0; index < count; index++) {
    const picture = new ImageData(64, 64);
    picture.data.fill(window.frame % 251);
    await window.localiser.localiseVideoFrame(picture, ++window.frame);
  }
  return (performance.now() - start) / count;
}

async function makesAndAborts({ count, camera }) {
  const start = performance.now();
  const picture = new ImageData(64, 64);
  for (let index = 0; index < count; index++) {
    const ending = new AbortController();
    const timer = setTimeout(() => ending.abort(), 60 * Math.random());
    try {
      const localiser = await window.gravisight.Localiser.create({ model: "golden/tiny.json", camera, device: "cpu", signal: ending.signal });
      const found = localiser.localise(picture, { signal: ending.signal }).catch((thrown) => thrown);
      if (index % 2) await found;
      localiser.dispose();
      const end = await found;
      if (end instanceof Error && end.name !== "AbortError" && end.code !== "disposed") throw end;
    } catch (thrown) {
      if (thrown.name !== "AbortError") throw thrown;
    } finally {
      clearTimeout(timer);
    }
  }
  return (performance.now() - start) / count;
}

async function worlds({ count, camera }) {
  const localiser = await window.gravisight.Localiser.create({ model: "golden/tiny.json", camera, device: "cpu" });
  const found = [];
  for (let index = 0; index < count; index++) {
    const picture = new ImageData(64, 64);
    picture.data.fill(index);
    found.push((await localiser.localise(picture)).world);
  }
  localiser.dispose();
  return found;
}

async function loses(camera) {
  const picture = new ImageData(64, 64);
  picture.data.fill(200);
  const worker = new Worker("assets/losing.js", { type: "module" });
  const localiser = await window.gravisight.Localiser.create({ model: "golden/tiny.json", camera, device: "webgpu", worker });
  const before = await localiser.localise(picture);
  worker.postMessage("lose");
  const after = await localiser.localise(picture);
  localiser.dispose();
  worker.terminate();
  return `${before.device.kind} ${after.device.kind}`;
}
