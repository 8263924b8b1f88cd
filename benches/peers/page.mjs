/**
 * Times a cold load of the page over a connection of 20 Mbit/s, shared by page and Worker, files compressed as servers do; then
 * a walk through its steps, and how long each keeps the browser's main thread from answering.
 */
import { createServer } from "node:http";
import { existsSync, readFileSync } from "node:fs";
import { extname, join } from "node:path";
import { setTimeout as sleep } from "node:timers/promises";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { launch } from "../../tests/web/support/browser.js";

const RUNS = 5;
const BYTES_A_SECOND = 20e6 / 8;
const LATENCY_MS = 20;
const CHUNK = 16 * 1024;
const dist = fileURLToPath(new URL("../../web/dist", import.meta.url));
const TYPES = { ".js": "text/javascript", ".html": "text/html", ".css": "text/css", ".wasm": "application/wasm", ".json": "application/json", ".svg": "image/svg+xml" };

const files = new Map();
function fileOf(path) {
  if (!files.has(path)) {
    const bytes = readFileSync(path);
    files.set(path, extname(path) in TYPES ? { body: gzipSync(bytes), encoding: "gzip" } : { body: bytes });
  }
  return files.get(path);
}

let sent = 0;
/** When the line is free again. */
let free = 0;
const server = createServer(async (request, response) => {
  const { pathname } = new URL(request.url, "http://localhost");
  const path = join(dist, pathname === "/" ? "index.html" : decodeURIComponent(pathname));
  await sleep(LATENCY_MS);
  if (!existsSync(path)) return response.writeHead(404).end();
  const { body, encoding } = fileOf(path);
  response.setHeader("Content-Type", TYPES[extname(path)] ?? "application/octet-stream");
  if (encoding) response.setHeader("Content-Encoding", encoding);
  response.setHeader("Content-Length", body.length);
  if (request.method === "HEAD") return response.end();
  for (let at = 0; at < body.length; at += CHUNK) {
    const chunk = body.subarray(at, at + CHUNK);
    free = Math.max(free, performance.now()) + (1000 * chunk.length) / BYTES_A_SECOND;
    await sleep(Math.max(0, free - performance.now()));
    sent += chunk.length;
    response.write(chunk);
  }
  response.end();
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
const browser = await launch({ webgpu: false });
const url = `http://127.0.0.1:${server.address().port}/`;

/** A page of a new browser profile that keeps its long tasks. */
async function watched() {
  const page = await (await browser.newContext({ viewport: { width: 1280, height: 860 } })).newPage();
  await page.addInitScript(() => {
    window.tasks = [];
    new PerformanceObserver((list) => window.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask", buffered: true });
  });
  return page;
}

const rows = [];
for (let run = 0; run < RUNS; run++) {
  const page = await watched();
  sent = 0;
  const start = performance.now();
  await page.goto(url, { waitUntil: "commit" });
  await page.waitForFunction(() => document.querySelector('[data-part="world-x"]')?.value);
  const seconds = (performance.now() - start) / 1000;
  const tasks = await page.evaluate(() => window.tasks);
  rows.push({ "first ball, s": seconds.toFixed(2), "longest task of the page, ms": Math.round(Math.max(0, ...tasks)), "MB fetched": (sent / 1e6).toFixed(2) });
  await page.context().close();
}
console.table(rows);

const WALK = {
  "throw a ball": async (page) => {
    await page.getByTestId("live-throw").click();
    await page.getByTestId("live-state").filter({ hasText: /^Done/ }).waitFor();
  },
  "an example's video, its trajectory": async (page) => {
    await page.locator("#tab-video").click();
    await page.getByTestId("video-example").click();
    await page.getByTestId("video-fit").click();
    await page.getByTestId("video-cancel").waitFor({ state: "hidden" });
  },
  "an example's calibration": async (page) => {
    await page.locator("#tab-calibrate").click();
    await page.getByTestId("cal-sample").click();
    await page.getByTestId("cal-point-9").waitFor();
  },
  "an example's clip, labels proposed": async (page) => {
    await page.locator("#tab-label").click();
    await page.getByTestId("lab-synth").click();
    await page.getByTestId("lab-propose").click();
    await page.getByTestId("lab-cancel").waitFor({ state: "hidden" });
  },
  "30 steps of fine-tuning": async (page) => {
    await page.locator("#tab-tune").click();
    await page.getByTestId("tune-example").click();
    await page.getByTestId("tune-status").filter({ hasText: "clips are ready" }).waitFor();
    await page.getByTestId("tune-steps").fill("30");
    await page.getByTestId("tune-start").click();
    await page.getByTestId("tune-status").filter({ hasText: "Done" }).waitFor();
  },
};
const page = await watched();
page.setDefaultTimeout(300_000);
await page.goto(url);
await page.waitForFunction(() => document.querySelector('[data-part="world-x"]')?.value);
const walked = [];
for (const [step, walk] of Object.entries(WALK)) {
  await page.evaluate(() => (window.tasks = []));
  await walk(page);
  const tasks = await page.evaluate(() => window.tasks);
  walked.push({ step, "tasks over 50 ms": tasks.length, "longest, ms": Math.round(Math.max(0, ...tasks)) });
}
console.table(walked);
await browser.close();
server.close();
