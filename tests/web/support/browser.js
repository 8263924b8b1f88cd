/** Chromium, and pages of which every complaint is kept. */
import { chromium } from "playwright-core";

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
