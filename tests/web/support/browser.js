/** Chromium, and pages of which every complaint is kept. */
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { chromium, selectors } from "playwright-core";

// The page finds its parts by the same attribute.
selectors.setTestIdAttribute("data-part");

const QUIET = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
const WEBGPU = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"];

/** Launches the browser; `webgpu: false` leaves it without an adapter; `args` are more switches. */
export function launch({ webgpu = true, args = [] } = {}) {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    headless: true,
    args: [...QUIET, ...(webgpu ? WEBGPU : []), ...args],
  });
}

/** Added to the page's address: the model of the rendered samples' scenes alone, for what is about that one. */
export const SD_L = "?model=models/sd-l.json";

/**
 * Opens a page at `url`; console errors and uncaught errors are added to `complaints`. Without the service worker unless asked
 * for: requests that it makes cannot be routed.
 */
export async function open(browser, url, complaints, options = {}) {
  const page = await browser.newPage({ viewport: { width: 1280, height: 860 }, serviceWorkers: "block", ...options });
  page.on("console", (message) => {
    if (message.type() === "error") complaints.push(`console: ${message.text()} (${message.location().url})`);
  });
  page.on("pageerror", (error) => complaints.push(`uncaught: ${error.stack ?? error}`));
  await page.goto(url);
  return page;
}

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];

/** What axe has to say against a part of a page: a line for each rule, with its severity. */
export async function axe(page, selector = "html", runOnly = RULES) {
  await page.evaluate(AXE);
  return page.evaluate(
    async ([selector, runOnly]) => {
      const { violations } = await window.axe.run(selector, { runOnly });
      const line = ({ html, any }) => `${html.slice(0, 300)} ${any.map(({ message }) => message)}`;
      return violations.map(({ id, impact, nodes }) => `${impact}, ${id}: ${nodes.map(line).join("; ")}`);
    },
    [selector, runOnly],
  );
}

/** Presses a button of the page that saves a file, and returns the file's bytes. */
export async function saved(page, testId) {
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByTestId(testId).click()]);
  return readFileSync(await download.path());
}

/** The full number that a `data` element holds. */
export async function value(page, testId) {
  return Number(await page.getByTestId(testId).getAttribute("value"));
}
