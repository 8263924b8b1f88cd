/** Times a cold load of the page over a connection of 20 Mbit/s, shared by page and Worker; files compressed as servers do. */
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
const rows = [];
for (let run = 0; run < RUNS; run++) {
  const page = await (await browser.newContext()).newPage();
  await page.addInitScript(() => {
    window.tasks = [];
    new PerformanceObserver((list) => window.tasks.push(...list.getEntries().map(({ duration }) => duration))).observe({ type: "longtask", buffered: true });
  });
  sent = 0;
  const start = performance.now();
  await page.goto(`http://127.0.0.1:${server.address().port}/`, { waitUntil: "commit" });
  await page.waitForFunction(() => document.querySelector('[data-testid="world-x"]')?.value);
  const seconds = (performance.now() - start) / 1000;
  const tasks = await page.evaluate(() => window.tasks);
  rows.push({ "first ball, s": seconds.toFixed(2), "longest task of the page, ms": Math.round(Math.max(0, ...tasks)), "MB fetched": (sent / 1e6).toFixed(2) });
  await page.context().close();
}
console.table(rows);
await browser.close();
server.close();
