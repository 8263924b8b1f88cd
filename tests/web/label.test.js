/** Step Label of the page, as a user meets it. */
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { axe, launch, open, saved } from "./support/browser.js";
import { jsonFile, pictureOf, pngFile, samples } from "./support/demo.js";
import { serve } from "./support/server.js";

const PATIENCE = { timeout: 120_000 };
const ID = "env1/cam1/0003";
const complaints = [];
let server, browser, page, truth;

before(async () => {
  server = await serve();
  browser = await launch({ webgpu: false });
  page = await open(browser, `${server.url}#label`, complaints);
  await page.getByTestId("lab-synth").waitFor(PATIENCE);
});

after(async () => {
  await browser?.close();
  await server?.close();
});

test("a synthetic clip is made, with its camera and its truth", async () => {
  assert.ok(await page.getByTestId("lab-empty").isVisible());
  await page.getByTestId("lab-number").fill("3");
  await page.getByTestId("lab-synth").click();
  await page.getByTestId("lab-title").filter({ hasText: ID }).waitFor(PATIENCE);
  const clip = await stored();
  assert.equal(clip.pictures, clip.labels.length);
  assert.ok(clip.pictures >= 30 && clip.pictures <= 90, `${clip.pictures} frames`);
  truth = await project(clip.camera, clip.truth);
  assert.equal(await page.getByTestId("lab-tag").textContent(), "not labelled");
});

test("most proposals are within a pixel of the truth, and none is a label yet", async () => {
  await page.getByTestId("lab-propose").click();
  await page.getByTestId("lab-said").filter({ hasText: "The ball was found in" }).waitFor(PATIENCE);
  const { proposals, labels } = await notes();
  const off = proposals.flatMap((proposal, frame) => (proposal ? [Math.hypot(...proposal.image.map((value, axis) => value - truth[frame][axis]))] : []));
  const within = off.filter((pixels) => pixels <= 1).length;
  assert.ok(off.length >= 0.8 * truth.length && within >= 0.8 * off.length, `${within} of ${off.length} of ${truth.length}`);
  assert.match(await page.getByTestId("lab-truth").textContent(), new RegExp(`${within} of ${off.length} proposals`));
  assert.ok(labels.every((label) => label === undefined), "nobody has looked yet");
});

test("Enter accepts and goes on, a click corrects, N hides, Ctrl+Z takes it back", async () => {
  const { proposals } = await notes();
  const first = proposals.findIndex((proposal, frame) => frame > 2 && [0, 1, 2, 3, 4].every((more) => proposals[frame + more]));
  await page.getByTestId(`lab-cell-${first}`).click();
  await page.keyboard.press("Enter");
  assert.equal(await currentFrame(), first + 1);
  assert.equal(await state(first), "accepted");
  assert.deepEqual((await notes()).labels[first], proposals[first].image);

  const overlay = page.getByTestId("lab-picture");
  const box = await overlay.boundingBox();
  await overlay.click({ position: { x: box.width / 2, y: box.height / 4 } });
  assert.equal(await state(first + 1), "corrected");
  const [u, v] = (await notes()).labels[first + 1];
  assert.ok(Math.abs(u - 111.5) < 1 && Math.abs(v - 55.5) < 1, `${u}, ${v}`);

  for (const key of ["Alt+ArrowRight", "Alt+ArrowRight", "Alt+ArrowUp"]) await page.keyboard.press(key);
  const moved = (await notes()).labels[first + 1];
  assert.ok(Math.abs(moved[0] - u - 1) < 1e-6 && Math.abs(moved[1] - v + 0.5) < 1e-6, `${moved} from ${u}, ${v}`);
  await page.keyboard.press("Control+z");
  assert.deepEqual((await notes()).labels[first + 1], [u, v], "a move is undone as one");

  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("n");
  assert.equal(await state(first + 2), "hidden");
  assert.equal((await notes()).labels[first + 2], null);
  await page.keyboard.press("Control+z");
  assert.notEqual(await state(first + 2), "hidden");
  await page.keyboard.press("n");
  await page.keyboard.press("ArrowLeft");
  assert.equal(await currentFrame(), first + 1);
  assert.match(await page.getByTestId(`lab-cell-${first + 2}`).getAttribute("aria-label"), /Frame \d+: ball not visible/);
});

test("in an enlarged frame a click is as exact as it is shown", async () => {
  const overlay = page.getByTestId("lab-picture");
  await page.getByTestId("lab-cell-1").click();
  await overlay.focus();
  const { width, height } = await overlay.boundingBox();
  await page.getByTestId("lab-picture-zoom-in").click();
  await overlay.focus();
  await page.keyboard.press("+");
  // About the middle, or about the label: what is there stays there.
  const shown = await page.locator(".label .picture-zoomed").evaluate((picture) => {
    const [outer, inner] = [picture.parentElement, picture].map((each) => each.getBoundingClientRect());
    return { scale: inner.width / outer.width, left: inner.left - outer.left, top: inner.top - outer.top };
  });
  assert.ok(Math.abs(shown.scale - 2.25) < 0.01, JSON.stringify(shown));
  await overlay.click({ position: { x: width / 4, y: height / 3 } });
  const [u, v] = (await notes()).labels[1];
  const expected = [(width / 4 - shown.left) / (width * shown.scale), (height / 3 - shown.top) / (height * shown.scale)].map((part) => 224 * part - 0.5);
  assert.ok(Math.abs(u - expected[0]) < 0.3 && Math.abs(v - expected[1]) < 0.3, `${u}, ${v}, not ${expected}`);
  await page.keyboard.press("Control+z");
  await page.keyboard.press("0");
  assert.equal(await page.getByTestId("lab-picture-zoom").textContent(), "100 %");
});

test("the doubtful frames alone are gone through", async () => {
  const doubtful = await page.locator('.lab-strip [data-state="doubtful"], .lab-strip [data-state="open"]').count();
  await page.getByTestId("lab-doubtful").check();
  await page.getByTestId("lab-picture").focus();
  if (doubtful > 0) {
    await page.keyboard.press("Enter");
    assert.ok(["doubtful", "open"].includes(await state(await currentFrame())));
  } else {
    await page.keyboard.press("Enter");
    assert.match(await page.getByTestId("lab-said").textContent(), /No doubtful frame is left/);
  }
  await page.getByTestId("lab-doubtful").uncheck();
});

test("all sure ones are accepted at once, and undone at once", async () => {
  const sure = () => page.locator('.lab-strip [data-state="sure"]').count();
  const before = await sure();
  assert.ok(before > 5, `${before} sure`);
  await page.getByTestId("lab-accept-sure").click();
  assert.equal(await sure(), 0);
  await page.getByTestId("lab-undo").click();
  assert.equal(await sure(), before);
  await page.getByTestId("lab-accept-sure").click();
});

test("a reload keeps clip, labels and frame; the clip is listed with its count", async () => {
  await page.getByTestId("lab-held").check();
  const before = await notes();
  await page.waitForTimeout(1200);
  await page.reload();
  await page.getByTestId("lab-title").filter({ hasText: ID }).waitFor(PATIENCE);
  const now = await notes();
  assert.deepEqual(now, before);
  const clip = await stored();
  assert.deepEqual(clip.labels, before.labels, "the other steps see the labels");
  assert.ok(clip.heldOut && (await page.getByTestId("lab-held").isChecked()));
  const labelled = before.labels.filter((label) => label !== undefined).length;
  await page.getByTestId(`lab-clip-${ID}`).filter({ hasText: `${labelled} of ${before.labels.length} labelled` }).waitFor(PATIENCE);
});

test("axe finds nothing to complain of, in light and in dark", async () => {
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    assert.deepEqual(await axe(page, "#panel-label"), [], colorScheme);
  }
  await page.emulateMedia({ colorScheme: null });
});

test("the files say what was labelled", async () => {
  const { labels } = await stored();
  const csv = (await saved(page, "lab-save-csv")).toString().trim().split("\n");
  assert.equal(csv[0], "Frame,Visibility,X,Y");
  const looked = labels.flatMap((label, frame) => (label === undefined ? [] : [[frame, label]]));
  assert.equal(csv.length - 1, looked.length);
  for (const [index, [frame, label]] of looked.entries()) {
    assert.equal(csv[index + 1], label ? `${frame},1,${label[0].toFixed(3)},${label[1].toFixed(3)}` : `${frame},0,0,0`);
  }
  const clip = JSON.parse(await saved(page, "lab-save-jsonl"));
  assert.deepEqual(Object.keys(clip), ["id", "fps", "camera", "scene", "frames"]);
  assert.equal(clip.frames.length, looked.length);
  for (const [index, [frame, label]] of looked.entries()) {
    const { file, image, visible } = clip.frames[index];
    assert.equal(file, `env1_cam1_0003/${String(frame).padStart(3, "0")}.png`);
    assert.deepEqual([image, visible], label ? [label, true] : [undefined, false]);
  }
});

test("pictures and clips.jsonl are written into a folder, and another clip's line stays", async () => {
  await page.evaluate(async () => {
    const root = await navigator.storage.getDirectory();
    const file = await (await root.getFileHandle("clips.jsonl", { create: true })).createWritable();
    await file.write('{"id":"other"}\n');
    await file.close();
    // The picker asks a person; the folder that it would give is the browser's own here.
    window.showDirectoryPicker = async () => root;
  });
  await page.getByTestId("lab-save-pictures").click();
  await page.getByTestId("lab-said").filter({ hasText: "in the folder" }).waitFor(PATIENCE);
  const { lines, size, kind } = await page.evaluate(async () => {
    const root = await navigator.storage.getDirectory();
    const lines = (await (await (await root.getFileHandle("clips.jsonl")).getFile()).text()).trim().split("\n");
    const [folder, name] = JSON.parse(lines[1]).frames[0].file.split("/");
    const picture = await (await (await root.getDirectoryHandle(folder)).getFileHandle(name)).getFile();
    return { lines: lines.map((line) => JSON.parse(line).id), size: picture.size, kind: picture.type };
  });
  assert.deepEqual(lines, ["other", ID]);
  assert.ok(size > 1000 && kind === "image/png", `${size} bytes of ${kind}`);
});

test("a browser that cannot write a folder saves the labels and says what is missing", async () => {
  await page.evaluate(() => (window.showDirectoryPicker = undefined));
  assert.equal(JSON.parse(await saved(page, "lab-save-pictures")).id, ID);
  assert.match(await page.getByTestId("lab-export-note").textContent(), /only clips\.jsonl was saved.*folder env1_cam1_0003/);
});

test("own pictures take a camera of their size, or none for now", async () => {
  const files = [2, 10, 1].map((number, index) => pngFile(`shot_${number}.png`, pictureOf(samples[index])));
  await page.getByTestId("lab-files").setInputFiles(files);
  await page.getByTestId("lab-title").filter({ hasText: /^shot$/ }).waitFor(PATIENCE);
  assert.equal((await stored("shot")).camera, undefined);
  await page.getByTestId("lab-files").setInputFiles([...files, jsonFile({ ...samples[0].camera, width: 640, height: 480 })]);
  await page.getByTestId("lab-alert").filter({ hasText: "224 × 224 pixels; the camera was calibrated for 640 × 480" }).waitFor(PATIENCE);
  assert.equal((await stored("shot (2)")).camera, undefined);
  await page.getByTestId("lab-files").setInputFiles([...files, jsonFile(samples[0].camera)]);
  await page.getByTestId("lab-title").filter({ hasText: "shot (3)" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("lab-alert").textContent(), "");
  const clip = await stored("shot (3)");
  assert.deepEqual([clip.pictures, clip.fps, clip.times[1], clip.camera.width], [3, 30, 1 / 30, 224]);
  assert.deepEqual(clip.names, ["shot_1.png", "shot_2.png", "shot_10.png"]);
});

test("a video is read frame by frame, and can be cancelled", async () => {
  const bytes = Buffer.from(await page.evaluate(record), "base64");
  const video = { name: "my film.webm", mimeType: "video/webm", buffer: bytes };
  await page.getByTestId("lab-fps").fill("10");
  await page.getByTestId("lab-most").fill("6");
  await page.getByTestId("lab-files").setInputFiles([video]);
  await page.getByTestId("lab-title").filter({ hasText: "my film" }).waitFor(PATIENCE);
  const clip = await stored("my film");
  assert.equal(clip.pictures, 6);
  assert.ok(clip.times.every((time, frame) => frame === 0 || time > clip.times[frame - 1]));
  await page.getByTestId("lab-files").setInputFiles([{ name: "broken.mp4", mimeType: "video/mp4", buffer: Buffer.from("no film") }]);
  await page.getByTestId("lab-alert").filter({ hasText: "cannot play broken.mp4" }).waitFor(PATIENCE);
  await page.getByTestId("lab-number").fill("4");
  await page.getByTestId("lab-synth").click();
  await page.getByTestId("lab-cancel").click();
  await page.getByTestId("lab-said").filter({ hasText: "Cancelled" }).waitFor(PATIENCE);
  assert.equal(await page.getByTestId("lab-clip-env1/cam1/0004").count(), 0);
});

test("a kept clip is opened again, and deleted only after a question", async () => {
  await page.getByTestId(`lab-open-${ID}`).click();
  await page.getByTestId("lab-title").filter({ hasText: ID }).waitFor(PATIENCE);
  await page.getByTestId("lab-delete-shot").click();
  await page.getByTestId("lab-delete-no-shot").click();
  await page.getByTestId("lab-delete-shot").click();
  await page.getByTestId("lab-delete-yes-shot").click();
  await page.getByTestId("lab-clip-shot").waitFor({ state: "detached", ...PATIENCE });
  assert.equal(await stored("shot"), null);
  assert.notEqual(await stored(), null);
});

test("a phone shows the step without scrolling sideways", async () => {
  await page.setViewportSize({ width: 390, height: 844 });
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
});

test("nothing was reported to the console over the whole run", () => assert.deepEqual(complaints, []));

function kept(key) {
  return page.evaluate(
    (key) =>
      new Promise((resolve, reject) => {
        const opening = indexedDB.open("keyval-store");
        opening.onerror = () => reject(opening.error);
        opening.onsuccess = () => {
          const reading = opening.result.transaction("keyval").objectStore("keyval").get(key);
          reading.onsuccess = () => {
            opening.result.close();
            const value = reading.result;
            resolve(value ? { ...value, ...(value.pictures ? { pictures: value.pictures.length, names: value.pictures.map(({ name }) => name) } : {}) } : null);
          };
        };
      }),
    key,
  );
}
const stored = (id = ID) => kept(`clip ${id}`);
const notes = () => kept(`labelling ${ID}`);

async function project(camera, world) {
  const harness = await open(browser, `${server.url}harness.html`, complaints);
  const images = await harness.evaluate(async ([camera, world]) => (await window.gravisight.Toolbox.create()).project(camera, world), [camera, world]);
  await harness.context().close();
  return images;
}

async function state(frame) {
  return page.getByTestId(`lab-cell-${frame}`).getAttribute("data-state");
}

async function currentFrame() {
  return Number((await page.locator(".lab-strip [aria-current]").getAttribute("data-part")).replace("lab-cell-", ""));
}


/** A video of 0.7 s, 224 × 224, as base64: made here, so that the repository holds none. */
async function record() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 224;
  const context = canvas.getContext("2d");
  const recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: "video/webm;codecs=vp8" });
  const chunks = [];
  recorder.ondataavailable = ({ data }) => chunks.push(data);
  const stopped = new Promise((resolve) => (recorder.onstop = resolve));
  recorder.start();
  const begun = performance.now();
  while (performance.now() - begun < 700) {
    context.fillStyle = `hsl(${performance.now() / 5} 50% 50%)`;
    context.fillRect(0, 0, 224, 224);
    await new Promise((resolve) => setTimeout(resolve, 30));
  }
  recorder.stop();
  await stopped;
  const bytes = new Uint8Array(await new Blob(chunks).arrayBuffer());
  return btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));
}
