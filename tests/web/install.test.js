/** The packed package: what is in it, where it and its parts may lie, Workers without a bundler. docs.test.js has the rest. */
import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { cpSync, mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { build } from "vite";
import { launch } from "./support/browser.js";
import { pictureOf, samples } from "./support/demo.js";
import { copyModel, install } from "./support/installed.js";
import { serveFolder } from "./support/server.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));
/** No inline script, no eval, no blob: what a careful site allows. */
const CSP = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; connect-src 'self'; img-src 'self'";
let installed, folder, browser, server, page;
const complaints = [];

before(async () => {
  installed = install();
  folder = installed.folder;
  copyModel(folder);
  writeFileSync(join(folder, "camera.json"), JSON.stringify(samples[0].camera));
  writeFileSync(join(folder, "picture.png"), pictureOf(samples[0]));
  server = await serveFolder(folder, CSP);
  browser = await launch({ webgpu: false });
});

after(async () => {
  await browser?.close();
  server?.close();
  installed?.remove();
});

/** Opens a page that says the position in its title, and reads it. */
async function positionOn(path) {
  page = await browser.newPage();
  page.on("console", (message) => message.type() === "error" && complaints.push(`${path}: ${message.text()} ${message.location().url}`));
  page.on("pageerror", (error) => complaints.push(`${path}: ${error}`));
  await page.goto(server.url + path);
  await page.waitForFunction(() => document.title.startsWith("{"), null, { timeout: 60_000 }).catch(() => assert.fail(complaints.join("\n") || "no answer"));
  const found = JSON.parse(await page.title());
  await page.close();
  assert.equal(found.error, undefined, found.error);
  return found.world;
}

function isGolden(world) {
  golden[samples[0].file].world.forEach((value, axis) => assert.ok(Math.abs(value - world[axis]) < 1e-3, `${world}`));
}

/** What a user writes; `options` is more of `create`. */
const program = (options, from = "/node_modules/gravisight/dist/index.js", base = "/") => `
import { Localiser } from "${from}";
const camera = await (await fetch("${base}camera.json")).json();
try {
  const localiser = await Localiser.create({ model: "${base}sd-l.json", camera${options} });
  const { world } = await localiser.localise(await (await fetch("${base}picture.png")).blob());
  localiser.dispose();
  report({ world });
} catch (error) {
  report({ error: String(error) });
}`;
const inPage = "const report = (found) => { document.title = JSON.stringify(found); };";
const html = (script) => `<!doctype html><html><head><link rel="icon" href="/picture.png"></head><body><script type="module" src="${script}"></script></body></html>`;

test("the tarball holds what it must, and no more", () => {
  const { name, dependencies, sideEffects } = JSON.parse(readFileSync(join(folder, "node_modules/gravisight/package.json"), "utf8"));
  assert.equal(name, "gravisight");
  assert.equal(dependencies, undefined);
  assert.deepEqual(sideEffects, ["./dist/worker.js"]);
  const files = readdirSync(join(folder, "node_modules/gravisight")).sort();
  assert.deepEqual(files, ["LICENSE-APACHE", "LICENSE-MIT", "README.md", "dist", "models", "package.json", "wasm"]);
});

test("with the wasm in another folder", async () => {
  cpSync(join(folder, "node_modules/gravisight/wasm/cpu"), join(folder, "elsewhere/cpu"), { recursive: true });
  writeFileSync(join(folder, "elsewhere.js"), inPage + program(`, wasm: "/elsewhere"`));
  writeFileSync(join(folder, "elsewhere.html"), html("/elsewhere.js"));
  isGolden(await positionOn("elsewhere.html"));
});

test("on the page's own thread", async () => {
  writeFileSync(join(folder, "inline.js"), inPage + program(", worker: false"));
  writeFileSync(join(folder, "inline.html"), html("/inline.js"));
  isGolden(await positionOn("inline.html"));
});

test("inside a Worker of the user's, and through one that imports gravisight/worker and has messages of its own", async () => {
  writeFileSync(join(folder, "own-worker.js"), `const report = (found) => postMessage(found);${program(", worker: false")}`);
  writeFileSync(join(folder, "own.js"), `${inPage}new Worker("/own-worker.js", { type: "module" }).onmessage = ({ data }) => report(data);`);
  writeFileSync(join(folder, "own.html"), html("/own.js"));
  isGolden(await positionOn("own.html"));
  writeFileSync(join(folder, "given-worker.js"), `import "/node_modules/gravisight/dist/worker.js"; self.addEventListener("message", ({ data }) => data === "hello" && [null, "mine"].forEach((each) => postMessage(each)));`);
  const given = `
const worker = new Worker("/given-worker.js", { type: "module" });
const heard = new Promise((resolve) => (worker.onmessage = ({ data }) => data === "mine" && resolve()));
worker.postMessage("hello");
const report = async (found) => { await heard; document.title = JSON.stringify(found); };
${program(", worker")}`;
  writeFileSync(join(folder, "given.js"), given);
  writeFileSync(join(folder, "given.html"), html("/given.js"));
  isGolden(await positionOn("given.html"));
});

test("in a Vite app that lies in any folder of a server", { timeout: 120_000 }, async () => {
  const app = join(folder, "vite");
  mkdirSync(app);
  writeFileSync(join(app, "index.html"), html("/main.js"));
  writeFileSync(join(app, "main.js"), inPage + program("", "gravisight", "../../"));
  await build({ root: app, base: "./", logLevel: "error", configFile: false });
  isGolden(await positionOn("vite/dist/index.html"));
});

test("a strict TypeScript program reads results and the card by their types, and a wrong name is refused", () => {
  const read = (name) => `
import { Localiser, Track, type Camera, type Scene } from "gravisight";
export async function look(camera: Camera, scene: Scene, picture: Blob): Promise<(number | null | undefined)[]> {
  const localiser = await Localiser.create({ model: "m.json", camera });
  const { world, heatmap, dtg } = await localiser.localise(picture, { heatmap: true, truth: [0, 0, 0] });
  const { points, ${name} } = await (await Track.create({ camera, scene })).fit();
  const { confidence_threshold, metrics } = localiser.card;
  return [world[2], heatmap?.values[0], dtg, points[0]?.residualPx?.[1], ${name}, confidence_threshold, metrics?.dtg?.mean];
}`;
  const check = (name) => {
    writeFileSync(join(folder, "typed.ts"), read(name));
    const options = ["--noEmit", "--strict", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom", "--types", "", "typed.ts"];
    return spawnSync(join(root, "node_modules/.bin/tsc"), options, { cwd: folder, encoding: "utf8" }).stdout.trim();
  };
  assert.equal(check("rmsPx"), "");
  assert.match(check("rms_px"), /typed\.ts.*rms_px/);
});

test("publint and are-the-types-wrong find nothing", () => {
  const tool = (name) => join(root, "node_modules/.bin", name);
  execFileSync(tool("publint"), ["--strict", join(folder, "node_modules/gravisight")], { stdio: "pipe" });
  execFileSync(tool("attw"), [installed.tarball, "--profile", "esm-only", "--exclude-entrypoints", "./wasm/*"], { stdio: "pipe" });
});

test("nothing was reported to the console", () => {
  assert.deepEqual(complaints, []);
});
