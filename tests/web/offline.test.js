/** The page without a network, after it was opened once with one. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { launch, open } from "./support/browser.js";
import { forget, located, press, samples, shown } from "./support/demo.js";
import { serve } from "./support/server.js";

const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));

test("opened once, the page finds balls and has all of its steps with no server and no network", async () => {
  const complaints = [];
  const server = await serve();
  const browser = await launch({ webgpu: false });
  try {
    const page = await open(browser, server.url, complaints, { serviceWorkers: "allow" });
    await located(page);
    await page.waitForFunction(() => document.querySelector('[data-part="offline-note"]').textContent !== "");
    // A rendered sample is compared with what the other model finds, which is kept, too.
    await press(page, 0);
    await page.getByTestId("other-error-cm").waitFor();
    await server.close();
    await page.context().setOffline(true);
    await page.goto(`${server.url}?device=auto`);
    await located(page);
    assert.match(await page.getByTestId("model-note").textContent(), /^Model any:/);
    await forget(page);
    await page.getByTestId("model-sd-l").check({ force: true });
    await page.getByTestId("model-note").filter({ hasText: "Model sd-l:" }).waitFor();
    // The sample that was shown is looked at again; another one is pressed after it, or its position is taken for that one's.
    await located(page);
    await press(page, 2);
    const world = await shown(page, "world-x", "world-y", "world-z");
    golden[samples[2].file].world.forEach((value, axis) => assert.ok(Math.abs(value - world[axis]) < 2e-3, `${world}`));
    await page.getByRole("tab", { name: "Calibrate" }).click();
    await page.getByTestId("cal-court").locator("option").nth(3).waitFor({ state: "attached" });
    await page.getByRole("tab", { name: "Your video" }).click();
    await page.getByTestId("video-rally").click();
    await page.getByTestId("video-plan").waitFor({ timeout: 120_000 });
    assert.match(await page.title(), /^Your video · gravisight$/);
    assert.deepEqual(complaints, []);
  } finally {
    await browser.close();
  }
});
