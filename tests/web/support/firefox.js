/** Debian's Firefox, driven by its own protocol (WebDriver BiDi), which Playwright's client cannot speak to it. */
import puppeteer from "puppeteer-core";

/** Launches it headless. */
export function launchFirefox() {
  return puppeteer.launch({ browser: "firefox", executablePath: process.env.FIREFOX ?? "/usr/bin/firefox-esr", headless: true, protocolTimeout: 600_000 });
}

/** Opens a page at `url`; console errors and uncaught errors are added to `complaints`. */
export async function openInFirefox(browser, url, complaints) {
  const page = await browser.newPage();
  page.on("console", (message) => message.type() === "error" && complaints.push(`console: ${message.text()}`));
  page.on("pageerror", (error) => complaints.push(`uncaught: ${error.stack ?? error}`));
  await page.goto(url);
  return page;
}
