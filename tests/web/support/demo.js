/** What the tests do with the demo page. */
import { readFileSync } from "node:fs";

const samplesFolder = new URL("../../../web/public/samples/", import.meta.url);

/** The rendered ones, as in `web/public/samples/samples.json`. */
export const samples = JSON.parse(readFileSync(new URL("samples.json", samplesFolder), "utf8"));

/** The bytes of a sample's picture. */
export const pictureOf = (sample) => readFileSync(new URL(sample.file, samplesFolder));

const realFolder = new URL("../../../web/public/real/", import.meta.url);

/** The real clip, as in `web/public/real/real.json`; its picture is the clip's frame 12, half as large. */
export const real = JSON.parse(readFileSync(new URL("real.json", realFolder), "utf8"));

/** The clip's hand labels, pixels of its 1920 × 1080. */
export const realLabels = readFileSync(new URL("../../../docs/labels/toss_wall.csv", import.meta.url), "utf8")
  .trim()
  .split("\n")
  .slice(1)
  .map((line) => line.split(",").map(Number))
  .map(([frame, , x, y, radius]) => ({ frame, image: [x, y], radius }));

/** A file to drop. */
export const pngFile = (name, bytes) => ({ name, mimeType: "image/png", buffer: bytes });
export const jsonFile = (content, name = "camera.json") => ({
  name,
  mimeType: "application/json",
  buffer: Buffer.from(typeof content === "string" ? content : JSON.stringify(content)),
});

/** A whole and valid picture of one pixel. */
export const ONE_PIXEL = Buffer.from(
  "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg==",
  "base64",
);

/** Loading and the first pass take this long at most, on a busy machine. */
const PATIENCE = { timeout: 120_000 };

/** Waits until the page has done what it was asked to do. */
export async function ready(page) {
  await page.waitForFunction(() => document.querySelector('[data-part="status"]').textContent === "ready", null, PATIENCE);
}

/** Waits until a position is shown; a model that cannot be loaded ends the wait. */
export async function located(page) {
  const settled = await page.waitForFunction(
    () => {
      const status = document.querySelector('[data-part="status"]').textContent;
      return status === "not loaded" || (status === "ready" && document.querySelector('[data-part="world-x"]').value !== "" && status);
    },
    null,
    PATIENCE,
  );
  if ((await settled.jsonValue()) === true) throw new Error(`no model: ${await page.getByTestId("alert").textContent()}`);
}

/** Presses a rendered sample and waits for its position. */
export async function press(page, index) {
  await forget(page);
  await page.getByTestId(`sample-${index}`).click();
  await located(page);
}

/** Blanks the shown position, so that the next one can be told from it. */
export async function forget(page) {
  await page.evaluate(() => {
    document.querySelector('[data-part="world-x"]').value = "";
  });
}

/** The numbers that are shown, in full. */
export async function shown(page, ...testIds) {
  const values = await Promise.all(testIds.map((id) => page.getByTestId(id).getAttribute("value")));
  return values.flatMap((value) => value.split(" ").map(Number));
}

/** Drops files on the page's drop zone, as a user does. */
export async function drop(page, ...files) {
  const plain = files.map(({ name, mimeType, buffer }) => ({ name, mimeType, base64: buffer.toString("base64") }));
  await page.evaluate(async (list) => {
    const transfer = new DataTransfer();
    for (const { name, mimeType, base64 } of list) {
      const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
      transfer.items.add(new File([bytes], name, { type: mimeType }));
    }
    const zone = document.querySelector('[data-part="drop"]');
    zone.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  }, plain);
}

/** Waits for words in the alert and returns them. */
export async function alertOf(page) {
  await page.waitForFunction(() => document.querySelector('[data-part="alert"]').textContent !== "", null, PATIENCE);
  await ready(page);
  return page.getByTestId("alert").textContent();
}
