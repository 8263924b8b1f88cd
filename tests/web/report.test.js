/** The report of `gravisight evaluate --report`, as a reader opens it: from a file, with no network. */
import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { launch, open } from "./support/browser.js";
import { gravisight } from "./support/command.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const screenshots = process.env.SCREENSHOTS ?? join(tmpdir(), "gravisight-screenshots");
const complaints = [];
let browser, address;

/** A log as training writes it. */
const log = Array.from({ length: 300 }, (_, index) => {
  const validation = index % 50 === 49 ? { dtg: { mean: 9 / (index + 1) }, image_error_px: { mean: 30 / (index + 1) } } : undefined;
  return JSON.stringify({ step: index + 1, steps: 300, loss: 9 / (index + 1), heatmap: 8 / (index + 1), depth: 1 / (index + 1), validation });
});

before(async () => {
  const folder = mkdtempSync(join(tmpdir(), "gravisight-report-"));
  const [report, logFile] = [join(folder, "report.html"), join(folder, "log.jsonl")];
  writeFileSync(logFile, log.join("\n"));
  gravisight(["evaluate", "--data", "tests/samples", "--model", "sd-l", "--report", report, "--log", logFile], { cwd: root });
  address = pathToFileURL(report).href;
  mkdirSync(screenshots, { recursive: true });
  browser = await launch({ webgpu: false });
});

after(async () => {
  await browser?.close();
});

for (const colorScheme of ["light", "dark"]) {
  for (const width of [1280, 390]) {
    test(`the report at ${width} px, ${colorScheme}: nothing asked for, nothing beside the page`, async () => {
      const context = await browser.newContext({ colorScheme, viewport: { width, height: 860 } });
      const asked = [];
      context.on("request", (request) => asked.push(request.url()));
      const page = await open(context, address, complaints);
      const requests = asked.filter((url) => url !== address && !url.startsWith("data:"));
      assert.deepEqual(requests, []);
      const sideways = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
      assert.ok(sideways <= 0, `${sideways} px beside the page`);
      await page.screenshot({ path: join(screenshots, `report-${width}-${colorScheme}.png`), fullPage: true });
      await context.close();
    });
  }
}

test("the colours of charts are the page's, by day and by night", async () => {
  const ink = async (colorScheme) => {
    const context = await browser.newContext({ colorScheme });
    const page = await open(context, address, complaints);
    const colours = await page.evaluate(() => {
      const body = getComputedStyle(document.body);
      const of = (selector) => getComputedStyle(document.querySelector(selector)).fill;
      return { page: body.backgroundColor, text: of("figure svg text"), bar: of("figure svg rect[stroke=none]") };
    });
    await context.close();
    return colours;
  };
  const [day, night] = [await ink("light"), await ink("dark")];
  for (const what of ["page", "text", "bar"]) assert.notEqual(day[what], night[what], what);
});

test("every picture in it is whole", async () => {
  const page = await open(browser, address, complaints);
  const broken = await page.evaluate(async () => {
    const pictures = [...document.querySelectorAll("svg image")].map((image) => image.href.baseVal);
    const whole = await Promise.all(pictures.map((source) => Object.assign(new Image(), { src: source }).decode().then(() => true, () => false)));
    return { count: pictures.length, broken: whole.filter((fine) => !fine).length };
  });
  assert.ok(broken.count >= 9, `${broken.count} pictures`);
  assert.equal(broken.broken, 0);
  await page.close();
});

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});
