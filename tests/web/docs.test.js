/** Every page and program of docs/in-a-web-page.md, of docs/web.md and of the two READMEs, run as it stands there. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { after, before, test } from "node:test";
import { Localiser, Toolbox } from "gravisight";
import { build, createServer } from "vite";
import { launch, open } from "./support/browser.js";
import { gravisight } from "./support/command.js";
import { drawnCourt, pngOf, seatedCamera } from "./support/court.js";
import { pictureOf, pngFile, samples } from "./support/demo.js";
import { film } from "./support/film.js";
import { copyModel, install } from "./support/installed.js";
import { serveFolder } from "./support/server.js";

/** A page takes this long at most, on a busy machine. */
const PATIENCE = { timeout: 120_000 };
/** Frames of a video: a busy machine leaves many out. */
const FEWEST = 15;
const text = (path) => readFileSync(new URL(`../../${path}`, import.meta.url), "utf8");
const golden = JSON.parse(text("tests/golden/samples.json"))[samples[0].file].world;
/** Both pages for the web, one after the other; their programs lie in one folder. */
const guide = ["docs/in-a-web-page.md", "docs/web.md"].map((path) => text(path)).join("\n");
const written = { docs: blocksOf(guide), readme: blocksOf(text("README.md")), package: blocksOf(text("pkg/README.md")) };
/** Names of the blocks that a test has run. */
const run = { docs: [], readme: [], package: [] };
const complaints = [];
/** Where the model `any` finds the ball in the first sample. */
let measured;
let installed, folder, clip, built, plain, vite, browser, video;

before(async () => {
  installed = install();
  folder = installed.folder;
  const inFolder = (path) => join(folder, path);

  // The first sample's scene and camera are the set's.
  [clip] = ["train", "val"].map((split) => {
    gravisight(["synth", "--set", "sd-s", "--split", split, "--clips", "1", "--out", inFolder(`clips/${split}`)]);
    const lines = inFolder(`clips/${split}/clips.jsonl`);
    const { frames, ...made } = JSON.parse(readFileSync(lines, "utf8"));
    const shorter = { ...made, frames: frames.slice(0, 60) };
    writeFileSync(lines, JSON.stringify(shorter));
    return shorter;
  });
  // The pages' ball and court are those of tennis; the sample has its own.
  const ofSample = (code) => code.replace("0.0335", String(clip.scene.ball.radius)).replace('scene: "tennis"', `scene: ${JSON.stringify(clip.scene)}`);
  for (const [name, code] of written.docs) write(inFolder(name), ofSample(code));
  for (const at of ["", "public/"]) {
    copyModel(inFolder(`${at}models`));
    write(inFolder(`${at}camera.json`), JSON.stringify(clip.camera));
    write(inFolder(`${at}scene.json`), JSON.stringify(clip.scene));
  }
  for (const name of ["picture.png", "public/favicon.ico"]) write(inFolder(name), pictureOf(samples[0]));
  const options = ["--camera", inFolder("camera.json"), "--ball-radius", String(clip.scene.ball.radius), "--json"];
  measured = JSON.parse(gravisight(["localise", inFolder("picture.png"), ...options])).world;
  cpSync(inFolder("public"), inFolder("plain"), { recursive: true });
  for (const part of ["dist", "wasm"]) cpSync(inFolder(`node_modules/gravisight/${part}`), inFolder(`plain/gravisight/${part}`), { recursive: true });
  cpSync(inFolder("clips"), inFolder("public/clips"), { recursive: true });
  await build({ root: folder, logLevel: "error" });
  run.docs.push("vite.config.js");

  const [, policy] = guide.match(/^Content-Security-Policy: (.*)$/m);
  built = await serveFolder(inFolder("dist"), policy);
  plain = await serveFolder(inFolder("plain"), policy);
  browser = await launch({
    webgpu: false,
    args: ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", `--use-file-for-fake-video-capture=${inFolder("webcam.mjpeg")}`],
  });
  const page = await open(browser, `${built.url}index.html`, complaints);
  const pictures = clip.frames.map(({ file }) => readFileSync(inFolder(`clips/train/${file}`), "base64"));
  video = await film(page, { pictures, fps: clip.fps, width: clip.camera.width, height: clip.camera.height });
  await page.close();
  // What the webcam sees: one picture again and again.
  const still = await browser.newPage({ viewport: { width: 224, height: 224 } });
  await still.setContent(`<body style="margin: 0"><img src="data:image/png;base64,${pictureOf(samples[0]).toString("base64")}">`);
  write(inFolder("webcam.mjpeg"), await still.screenshot({ type: "jpeg", quality: 100 }));
  await still.close();
});

after(async () => {
  await browser?.close();
  await vite?.close();
  for (const server of [built, plain]) server?.close();
  installed?.remove();
});

test("a picture, in a Vite build", async () => {
  const page = await visit(built, "index.html", "main.js");
  await choosePicture(page);
  isMeasured(await shown(page, /x .* confidence [01]\.\d\d/));
  await page.locator("input").setInputFiles(pngFile("x.png", Buffer.from("no picture")));
  await shown(page, /PNG/);
  await page.close();
});

test("a picture, without a bundler", async () => {
  const page = await visit(plain, "plain/index.html", "plain/main.js");
  await choosePicture(page);
  isGolden(await shown(page, /x .* confidence 0\.\d\d/));
  await page.close();
});

test("a canvas, with the core alone", async () => {
  const page = await visit(plain, "plain/core.html", "plain/core.js");
  await choosePicture(page);
  isGolden(await shown(page, /x /));
  await page.close();
});

test("a video file: the verdict, and the positions in its flights", async () => {
  const page = await visit(built, "video.html", "video.js");
  await chooseVideo(page);
  const track = await shown(page, /explained/, "pre");
  assert.match(track, /^explained: .*the ball was found in \d+ of \d+ frames/);
  const points = [...track.matchAll(/^([\d.]+) s: (.*) m ± .* m$/gm)].map(([, seconds, point]) => ({ seconds, world: point.split(", ").map(Number) }));
  areNearTruth(points, 0.1);
  // The page is ready for another file.
  await chooseNotes(page);
  await shown(page, /cannot play/, "pre");
  await page.locator("input:enabled").waitFor(PATIENCE);
  await page.close();
});

test("a trajectory while a video plays", async () => {
  const page = await visit(built, "track.html", "track.js");
  await chooseVideo(page);
  const trajectory = await shown(page, /./, "pre");
  assert.match(trajectory, /^Physics explains the frames\.\nbounce at /);
  const points = [...trajectory.matchAll(/^([\d.]+) s: (.*) ± .* m\/s$/gm)].map(([, seconds, point]) => ({ seconds, world: positionIn(point) }));
  areNearTruth(points, 0.05);
  // The same again: the page is ready for another file.
  await chooseNotes(page);
  await shown(page, /source|supported/);
  await page.locator("input:enabled").waitFor(PATIENCE);
  await page.close();
});

test("a webcam", async () => {
  const page = await visit(built, "webcam.html", "webcam.js");
  for (let times = 0; times < 2; times++) {
    await page.locator("#start:enabled").click(PATIENCE);
    const world = positionIn(await shown(page, /x .* confidence 0\.9/));
    assert.ok(distance(world, golden) < 0.1, `${world} is not near ${golden}`);
    await page.locator("#stop").click();
  }
  await page.close();
});

test("progress, and cancelling", async () => {
  const page = await visit(built, "loading.html", "loading.js");
  await shown(page, /^Ready: CPU/);
  await page.route("**/*.safetensors", () => {}); // a server that never answers
  await page.evaluate(() => caches.delete("gravisight"));
  await page.reload();
  await shown(page, /wasm 100 %/);
  await page.locator("button").click();
  await shown(page, /^Cancelled$/);
  await page.close();
});

test("inside a Worker of the user's, and through one", async () => {
  for (const names of [["inside.html", "inside.js", "inside-worker.js"], ["through.html", "through.js", "through-worker.js"]]) {
    const page = await visit(built, ...names);
    await choosePicture(page);
    isGolden(await shown(page, /x /));
    await page.close();
  }
});

test("in Node.js", () => {
  const lines = node("find.js", "picture.png", join("clips/train", clip.frames[20].file)).trim().split("\n").map(JSON.parse);
  isNear(lines[0].world, golden, 1e-3);
  isNear(lines[1].world, clip.frames[20].world, 0.1);
});

test("weights that the command trained", () => {
  const [, line] = guide.match(/^gravisight (train .*)$/m);
  gravisight([...line.split(" "), "--set", "phases=[{steps=2,batch=2,learning_rate=1e-3}]", "--set", "validate_frames=2"], { cwd: folder });
  const { world } = JSON.parse(gravisight(["localise", "picture.png", "--camera", "camera.json", "--model", "runs/mine/mine", "--json"], { cwd: folder }));
  isNear(JSON.parse(node("own.js")), world, 1e-3);
});

test("weights that were tuned in the page", async () => {
  const page = await visit(built, "tune.html", "tune.js");
  await page.locator("#start").click();
  await shown(page, /^Step \d+ of 200/);
  await page.locator("#stop").click();
  assert.match(await shown(page, /Forecasts/, "pre"), /off by \d+\.\d\d px, now \d+\.\d\d px/);
  for (const link of await page.locator("a").all()) {
    const [file] = await Promise.all([page.waitForEvent("download"), link.click()]);
    await file.saveAs(join(folder, "tuned", file.suggestedFilename()));
  }
  await page.close();
  const localiser = await Localiser.create({ model: join(folder, "tuned/sd-l-tuned.json"), camera: samples[0].camera });
  isNear((await localiser.localise(pictureOf(samples[0]))).world, samples[0].world, 0.5);
  localiser.dispose();
});

test("a camera from clicks on a tennis court, one of them wrong", async () => {
  // 25 m from the net's middle and 8 m above it, looking there.
  const far = Math.hypot(25, 8);
  const [sin, cos] = [8 / far, 25 / far];
  const camera = {
    width: 1280,
    height: 860,
    intrinsic: [[1000, 0, 639.5], [0, 1000, 429.5], [0, 0, 1]],
    camera_from_world: [[1, 0, 0, 0], [0, -sin, -cos, 0], [0, cos, -sin, far], [0, 0, 0, 1]],
  };
  const toolbox = await Toolbox.create();
  const { points } = await toolbox.court("tennis");
  const names = Object.keys(points);
  const seen = await toolbox.project(camera, Object.values(points));

  const page = await visit(built, "calibrate.html", "calibrate.js");
  await page.locator("option").first().waitFor({ state: "attached", ...PATIENCE });
  await page.locator("select").selectOption("tennis");
  await page.locator("input:enabled").setInputFiles(pngFile("court.png", await page.screenshot()));
  for (const [index, name] of names.entries()) {
    await page.locator("output").getByText(`Click: ${name}`, { exact: true }).waitFor(PATIENCE);
    const [x, y] = seen[index];
    const slip = index === 4 ? 30 : 0;
    if (x > 0 && x < 1280 && y > 0 && y < 860) await page.locator("canvas").click({ position: { x: x + 0.5 + slip, y: y + 0.5 } });
    else await page.locator("#skip").click();
  }
  await shown(page, /last point/);
  await page.locator("#done").click();
  const words = await shown(page, /Off by/, "#result");
  assert.ok(words.endsWith(`wrong clicks: ${names[4]}`), words);
  const [file] = await Promise.all([page.waitForEvent("download"), page.locator("a").click()]);
  const found = JSON.parse(readFileSync(await file.path(), "utf8"));
  const again = await toolbox.project(found, Object.values(points));
  const off = again.map((image, index) => distance(image, seen[index]));
  assert.ok(Math.max(...off) < 1.5, `off by up to ${Math.max(...off)} px`);
  await shown(page, /^(No ball found|The ball: x .* m)\./);
  toolbox.dispose();
  await page.close();
});

test("the READMEs' lines, and the first page, in Vite's development server", async () => {
  /** What the READMEs' lines take for granted. */
  const given = `
    import { Localiser } from "gravisight";
    const [camera, scene] = await Promise.all(["/camera.json", "/scene.json"].map(async (url) => (await fetch(url)).json()));`;
  const shownVideo = `
    const localiser = await Localiser.create({ model: "/models/sd-l.json", camera });
    const video = document.querySelector("video");
    video.src = "/clip.webm";`;
  const twoClips = `
    const frames = ${JSON.stringify(clip.frames.slice(0, 20))};
    for (const frame of frames) frame.picture = await (await fetch("/clips/train/" + frame.file)).blob();
    const another = { id: "another", fps: ${clip.fps}, camera, scene, frames };
    const clips = [{ ...another, id: "one" }];`;
  const allFrames = `
    const frames = ${JSON.stringify(clip.frames)};
    for (const frame of frames) Object.assign(frame, { picture: await (await fetch("/clips/train/" + frame.file)).blob(), timestampMs: 1000 * frame.t });`;
  // Two throws, one after the other.
  const twoThrows = `
    import { film } from "/throw.js";
    const frames = [...film(), ...film()].map(({ picture }, index) => ({ picture, timestampMs: (1000 * index) / 30 }));`;
  // The clip is of a scene of its own, and no tennis.
  const ownScene = written.package.get("tracker.js").replace('scene: "tennis"', "scene");
  const fewSteps = written.package.get("tune.js").replaceAll("200", "2");
  const pages = {
    // The README's ball is a tennis ball; the sample's is larger.
    "readme/main": `${written.readme.get("main.js").replace("0.0335", String(clip.scene.ball.radius))}\nconsole.log("ready");`,
    "package/main": `${written.package.get("main.js").replace("0.0335", String(clip.scene.ball.radius))}\nconsole.log("ready");`,
    "package/track": `${given}${shownVideo}\n${written.package.get("track.js")}\nvideo.play();`,
    "package/tracker": `${given}${allFrames}\n${ownScene}`,
    "package/court": written.package.get("court.js"),
    "package/circle": written.package.get("circle.js"),
    "package/adapt": `${twoThrows}\n${written.package.get("adapt.js").replace("300", "2")}`,
    "package/tune": `${given}${twoClips}\n${fewSteps}\nconsole.log(JSON.parse(card).name, weights.length);`,
  };
  write(join(folder, "throw.js"), text("tests/web/support/throw.js"));
  write(join(folder, "public/clip.webm"), video);
  write(join(folder, "public/court.png"), await drawnTennisCourt());
  for (const [name, code] of Object.entries(pages)) {
    write(join(folder, `${name}.js`), code);
    write(join(folder, `${name}.html`), `<!doctype html><input type="file"><video muted></video><script type="module" src="/${name}.js"></script>`);
  }
  vite = await createServer({ root: folder, logLevel: "error", server: { host: "127.0.0.1", port: 0 } });
  await vite.listen();
  const [url] = vite.resolvedUrls.local;

  const first = await open(browser, url, complaints);
  await choosePicture(first);
  isMeasured(await shown(first, /x .* confidence [01]\.\d\d/));
  await first.close();

  for (const where of ["readme", "package"]) {
    const page = await open(browser, "about:blank", complaints);
    const [found] = await Promise.all([
      logged(page, /^x y z = /),
      logged(page, /^ready$/).then(() => choosePicture(page)),
      page.goto(`${url}${where}/main.html`),
    ]);
    isNear(found.text().match(/= (\S+) m,/)[1].split(",").map(Number), measured, 1e-3);
    run[where].push("main.js");
    await page.close();
  }

  const tracking = await open(browser, "about:blank", complaints);
  const [fitted] = await Promise.all([logged(tracking, /^(true|false) /), tracking.goto(`${url}package/track.html`)]);
  const [explained, fittedFrames, impacts] = await Promise.all(fitted.args().map((each) => each.jsonValue()));
  assert.ok(explained && fittedFrames.length >= FEWEST && impacts.length > 0);
  run.package.push("track.js");
  await tracking.close();

  const through = await open(browser, "about:blank", complaints);
  const [tracked] = await Promise.all([logged(through, /the ball was found in/), through.goto(`${url}package/tracker.html`)]);
  const [verdict, isExplained, flights] = await Promise.all(tracked.args().map((each) => each.jsonValue()));
  assert.ok(isExplained && flights.length > 0, verdict);
  run.package.push("tracker.js");
  await through.close();

  const finding = await open(browser, "about:blank", complaints);
  const [found] = await Promise.all([logged(finding, /^camera:/), finding.goto(`${url}package/court.html`)]);
  const { intrinsic } = await found.args()[1].jsonValue();
  isNear([intrinsic[0][0]], [seatedCamera.intrinsic[0][0]], 10);
  run.package.push("court.js");
  await finding.close();

  const circling = await open(browser, "about:blank", complaints);
  const [circled] = await Promise.all([logged(circling, /± [\d.]+ m/), circling.goto(`${url}package/circle.html`)]);
  // A ball of 11 cm that looks 60 px large before a lens of 26 mm (a diagonal of 43.27 mm on one of 5040 px).
  isNear([(await circled.args()[0].jsonValue())[1]], [(0.11 / 60) * (5040 / 43.27) * 26], 0.2);
  run.package.push("circle.js");
  await circling.close();

  const adapting = await open(browser, "about:blank", complaints);
  const learned = Promise.all([/^detector 1 6$/, /^motion network 6 6$|^verifier 4 4$/, /^reports the ball in \d|no network improved/].map((words) => logged(adapting, words)));
  await Promise.all([learned, adapting.goto(`${url}package/adapt.html`)]);
  run.package.push("adapt.js");
  await adapting.close();

  const tuning = await open(browser, "about:blank", complaints);
  const said = Promise.all([/^\d.* px before$/, /^1 \d/, /^2 \d/, /^\d.* px after$/, /^sd-l-tuned \d{6,}$/].map((words) => logged(tuning, words)));
  await Promise.all([said, tuning.goto(`${url}package/tune.html`)]);
  run.package.push("tune.js");
  await tuning.close();
});

test("every named block was run", () => {
  for (const [where, blocks] of Object.entries(written)) assert.deepEqual(run[where].toSorted(), [...blocks.keys()].toSorted(), where);
});

test("nothing was reported to the console", () => {
  assert.deepEqual(complaints, []);
});

/** The blocks that have a file's name after their language. */
function blocksOf(markdown) {
  return new Map([...markdown.matchAll(/^```\w+ (\S+)\n(.*?)^```$/gms)].map(([, name, code]) => [name, code]));
}

async function drawnTennisCourt() {
  const toolbox = await Toolbox.create();
  const { lines } = await toolbox.court("tennis");
  toolbox.dispose();
  return pngOf(drawnCourt(lines));
}

function write(path, content) {
  mkdirSync(dirname(path), { recursive: true });
  writeFileSync(path, content);
}

/** Opens the page that these blocks are. */
function visit({ url }, ...names) {
  run.docs.push(...names);
  return open(browser, url + names[0].replace(/^plain\//, ""), complaints);
}

async function choosePicture(page) {
  await page.locator("input:enabled").setInputFiles(pngFile("picture.png", pictureOf(samples[0])));
}

async function chooseVideo(page) {
  await page.locator("input:enabled").setInputFiles({ name: "clip.webm", mimeType: "video/webm", buffer: video });
}

/** Chooses a file that is named as a video and is none. */
async function chooseNotes(page) {
  await page.locator("input:enabled").setInputFiles({ name: "notes.webm", mimeType: "video/webm", buffer: Buffer.from("no video") });
}

/** Waits until an element says `words`, and returns all of what it says. */
async function shown(page, words, selector = "output") {
  const element = page.locator(selector).filter({ hasText: words });
  await element.waitFor(PATIENCE).catch(async () => assert.fail(`${await page.locator(selector).textContent()} ${complaints.join("\n")}`));
  return element.textContent();
}

/** Waits until the page logs `words`. */
function logged(page, words) {
  return page.waitForEvent("console", { predicate: (message) => words.test(message.text()), ...PATIENCE });
}

function node(name, ...args) {
  run.docs.push(name);
  return execFileSync("node", [name, ...args], { cwd: folder, encoding: "utf8" });
}

function positionIn(words) {
  return words.match(/x (\S+) m, y (\S+) m, z (\S+) m/).slice(1).map(Number);
}

function isGolden(words) {
  isNear(positionIn(words), golden, 1e-3);
}

/** The page rounds to millimetres. */
function isMeasured(words) {
  isNear(positionIn(words), measured, 2e-3);
}

/** Whether positions are those of enough of the clip's frames, and are off by less than `metres` on average. */
function areNearTruth(points, metres) {
  assert.ok(points.length >= FEWEST, `${points.length} of ${clip.frames.length} frames`);
  const off = points.map(({ seconds, world }) => distance(world, clip.frames[Math.round(seconds * clip.fps)].world));
  assert.ok(average(off) < metres, `off by ${average(off)} m on average`);
}

function isNear(world, expected, metres) {
  for (const [axis, value] of expected.entries()) assert.ok(Math.abs(value - world[axis]) < metres, `${world} is not ${expected}`);
}

function distance(a, b) {
  return Math.hypot(...a.map((coordinate, axis) => coordinate - b[axis]));
}

function average(values) {
  return values.reduce((sum, each) => sum + each, 0) / values.length;
}
