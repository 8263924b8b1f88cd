/** What the page lets nobody do, and that it runs from any folder of any server. */
import assert from "node:assert/strict";
import { cpSync, mkdtempSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { after, before, test } from "node:test";
import { launch, open } from "./support/browser.js";
import { located } from "./support/demo.js";
import { serve, serveFolder } from "./support/server.js";

let server, browser, page;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, server.url, []);
  await located(page);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

/** The directive that stopped what `act` does in the page, or the words of the page's own policy; nothing where neither did. */
async function stopped(act) {
  await page.evaluate(() => {
    window.stopped = new Promise((resolve) => {
      document.addEventListener("securitypolicyviolation", ({ effectiveDirective }) => resolve(effectiveDirective), { once: true });
      setTimeout(() => resolve(""), 2000);
    });
  });
  const refused = await page.evaluate(act).then(() => "", (thrown) => thrown.message);
  return (refused.match(/is not a script of this page/) ?? [])[0] ?? page.evaluate(() => window.stopped);
}

const attempts = {
  "a script in the page": ["is not a script of this page", () => document.body.append(Object.assign(document.createElement("script"), { src: "https://elsewhere.invalid/x.js" }))],
  "a style in the page": ["style-src-elem", () => document.body.append(Object.assign(document.createElement("style"), { textContent: "p{}" }))],
  "an event handler as an attribute": ["require-trusted-types-for", () => document.body.setAttribute("onclick", "alert(1)")],
  "a picture from elsewhere": ["img-src", () => document.body.append(Object.assign(document.createElement("img"), { src: "https://elsewhere.invalid/x.png" }))],
  "a request to elsewhere": ["connect-src", () => fetch("https://elsewhere.invalid/")],
  "a form": [
    "form-action",
    () => {
      const form = Object.assign(document.createElement("form"), { action: "https://elsewhere.invalid/" });
      document.body.append(form);
      form.submit();
    },
  ],
  "a frame": ["frame-src", () => document.body.append(Object.assign(document.createElement("iframe"), { src: "https://elsewhere.invalid/" }))],
  "another base": ["base-uri", () => document.head.append(Object.assign(document.createElement("base"), { href: "https://elsewhere.invalid/" }))],
  "markup from a string": ["require-trusted-types-for", () => (document.createElement("p").innerHTML = "<img src=x onerror=alert(1)>")],
  "a Worker from elsewhere": ["is not a script of this page", () => new Worker("https://elsewhere.invalid/worker.js")],
  "a policy of one's own": ["trusted-types", () => window.trustedTypes.createPolicy("mine", { createHTML: (markup) => markup })],
};
for (const [what, [directive, act]] of Object.entries(attempts)) {
  test(`${what} is stopped`, async () => assert.equal(await stopped(act), directive));
}

test("what an address asks for is no script and no markup", async () => {
  const complaints = [];
  for (const query of ["?model=javascript:alert(1)", "?model=data:application/json,{}", "?model=https://elsewhere.invalid/x.json", '?device="><img src=x onerror=alert(1)>', "#<img src=x onerror=alert(1)>"]) {
    const other = await open(browser, server.url + query, complaints);
    other.on("dialog", () => assert.fail(`${query} ran a script`));
    await other.waitForFunction(() => document.querySelector('[data-part="status"]').textContent !== "");
    await other.waitForTimeout(500);
    assert.equal(await other.evaluate(() => document.querySelectorAll("img[src=x]").length), 0, query);
    await other.close();
  }
  assert.ok(!complaints.some((words) => words.startsWith("uncaught")), complaints.join("\n"));
});

test("a folder of a plain server is enough for the page", async () => {
  const folder = mkdtempSync(join(tmpdir(), "gravisight-site-"));
  cpSync(fileURLToPath(new URL("../../web/dist", import.meta.url)), join(folder, "some/where"), { recursive: true });
  const plain = await serveFolder(folder, "");
  try {
    const complaints = [];
    const other = await open(browser, `${plain.url}some/where/index.html`, complaints);
    await located(other);
    await other.getByRole("tab", { name: "Calibrate" }).click();
    await other.getByTestId("cal-court").locator("option").nth(3).waitFor({ state: "attached" });
    assert.deepEqual(complaints, []);
  } finally {
    plain.close();
  }
});
