/** Pictures of the page, to be looked at: in `SCREENSHOTS`, or in the system's folder for temporary files. */
import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { alertOf, drop, jsonFile, pngFile, press, samples, located } from "./support/demo.js";
import { serve } from "./support/server.js";

const folder = process.env.SCREENSHOTS ?? join(tmpdir(), "gravisight-screenshots");
const complaints = [];
let server, browser;

before(async () => {
  mkdirSync(folder, { recursive: true });
  server = await serve();
  browser = await launch();
});

after(async () => {
  await browser?.close();
  await server?.close();
});

for (const colorScheme of ["light", "dark"]) {
  for (const width of [1280, 390]) {
    test(`the page at ${width} px, ${colorScheme}`, async () => {
      const page = await open(browser, server.url, complaints, { colorScheme, viewport: { width, height: 860 } });
      await located(page);
      const shoot = (what) => page.screenshot({ path: join(folder, `${what}-${width}-${colorScheme}.png`), fullPage: true });
      await shoot("heatmap");
      await press(page, 3);
      await page.getByTestId("layer-depth").check();
      await shoot("depth");
      await drop(page, pngFile("notes.png", Buffer.from("no picture")), jsonFile(samples[0].camera));
      await alertOf(page);
      await shoot("refused");
      await page.close();
    });
  }
}

test("nothing was reported to the console over the whole run", () => {
  assert.deepEqual(complaints, []);
});
