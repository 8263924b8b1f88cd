/** The packed package: what is in it, where it and its parts may lie, Workers without a bundler. docs.test.js has the rest. */
import assert from "node:assert/strict";
import { execFileSync, spawnSync } from "node:child_process";
import { cpSync, mkdirSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";
import { build } from "vite";
import { without } from "./support/builds.js";
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
  isNear(world, golden[samples[0].file].world, 1e-3);
}

/** By default within 1.3 times what the package's own model is off on this picture, m. */
function isNear(world, expected, metres = 0.092) {
  assert.ok(Math.hypot(...world.map((value, axis) => value - expected[axis])) < metres, `${world} is not ${expected}`);
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
  assert.deepEqual(sideEffects, ["./dist/worker.js", "./dist/thread.js"]);
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

/** Copies the installed package, with other addresses for its own files than `new URL("…", import.meta.url)`, as bundlers make them. */
function bundledLike(name, addressOf) {
  const copy = join(folder, name);
  cpSync(join(folder, "node_modules/gravisight"), copy, { recursive: true });
  for (const file of readdirSync(join(copy, "dist")).filter((each) => each.endsWith(".js"))) {
    const path = join(copy, "dist", file);
    const code = readFileSync(path, "utf8");
    const moved = code.replaceAll(/new URL\("\.\.\/((?:wasm|models)[^"]*)", import\.meta\.url\)/g, (_, asset) => addressOf(asset));
    writeFileSync(path, moved);
  }
  return copy;
}

test("where the bundler makes paths from the server's root of the package's addresses, as Next.js does", async () => {
  // What Turbopack puts in the place of `URL`: an object whose parts are those of the path alone.
  bundledLike("rooted", (asset) => `Object.assign(Object.create(URL.prototype, { href: { value: "/rooted/${asset}" } }), { toString: () => "/rooted/${asset}" })`);
  for (const [name, options] of Object.entries({ worker: "", thread: ", worker: false" })) {
    writeFileSync(join(folder, `rooted-${name}.js`), inPage + program(`, ball: { radius: 0.2 }${options}`, "/rooted/dist/index.js").replace(/ model: [^,]*,/, ""));
    writeFileSync(join(folder, `rooted-${name}.html`), html(`/rooted-${name}.js`));
    isNear(await positionOn(`rooted-${name}.html`), samples[0].world);
  }
});

test("on a server whose bundler puts the wasm's script under a package.json that says commonjs, as Next.js does", () => {
  const assets = join(folder, "server/assets");
  mkdirSync(assets, { recursive: true });
  writeFileSync(join(folder, "server/package.json"), JSON.stringify({ type: "commonjs" }));
  for (const part of ["wasm", "models"]) cpSync(join(folder, "node_modules/gravisight", part), join(assets, part), { recursive: true });
  bundledLike("bundled", (asset) => `new URL("${pathToFileURL(join(assets, asset))}")`);
  const found = inNode(`
import { readFileSync } from "node:fs";
import { Localiser } from "./bundled/dist/index.js";
const localiser = await Localiser.create({ camera: JSON.parse(readFileSync("camera.json")), ball: { radius: 0.2 } });
console.log(JSON.stringify((await localiser.localise(readFileSync("picture.png"))).world));`);
  assert.equal(found.stderr, "");
  isNear(JSON.parse(found.stdout), samples[0].world);
});

test("what a bundler has lost on a server is said, with what to do", () => {
  bundledLike("lost", (asset) => `new URL("file:///_next/static/media/${asset}")`);
  const { stdout } = inNode(`
import { Toolbox } from "./lost/dist/index.js";
await Toolbox.create().catch(({ code, message }) => console.log(code, message));`);
  assert.match(stdout, /^cpu-build-missing .*_next\/static.*serverExternalPackages/);
});

test("a Node.js that is too old is told so", () => {
  // What the package needs is not in Node.js 18.
  const { stdout } = inNode(`
process.getBuiltinModule = undefined;
const { Toolbox } = await import("gravisight");
await Toolbox.create().catch(({ code, message }) => console.log(code, message));`);
  assert.match(stdout, new RegExp(`^node-version .*${process.version}; gravisight needs 20\\.19`));
});

test("the Node.js that the package asks for has all that is needed, require included", () => {
  const { engines } = JSON.parse(readFileSync(join(folder, "node_modules/gravisight/package.json"), "utf8"));
  // The first versions in which `require` takes ES modules.
  assert.equal(engines.node, "^20.19.0 || >=22.12.0");
  writeFileSync(join(folder, "required.cjs"), `require("gravisight").Toolbox.create().then((tools) => tools.courts()).then((courts) => console.log(courts.length));`);
  assert.ok(Number(execFileSync(process.execPath, ["--disable-warning=ExperimentalWarning", "required.cjs"], { cwd: folder, encoding: "utf8" })) > 3);
});

/** Runs a program in the folder of the installed package. */
function inNode(code) {
  return spawnSync(process.execPath, ["--input-type=module", "--eval", code], { cwd: folder, encoding: "utf8" });
}

test("a strict TypeScript program reads results and the card by their types, and a wrong name is refused", () => {
  const read = (name) => `
import { Localiser, Track, type Camera, type Scene } from "gravisight";
export async function look(camera: Camera, scene: Scene, picture: Blob): Promise<(number | null | undefined)[]> {
  const localiser = await Localiser.create({ model: "m.json", camera });
  const { world, heatmap, dtg } = await localiser.localise(picture, { heatmap: true, truth: [0, 0, 0] });
  const { frames, ${name} } = await (await Track.create({ camera, scene })).fit();
  const { confidence_threshold, metrics } = localiser.card;
  return [world[2], heatmap?.values[0], dtg, frames[0]?.residualPx?.[1], ${name}, confidence_threshold, metrics?.dtg?.mean];
}`;
  const check = (name, ...modules) => {
    writeFileSync(join(folder, "typed.ts"), read(name));
    const options = ["--noEmit", "--strict", "--target", "es2022", ...modules, "--lib", "es2022,dom", "--types", "", "typed.ts"];
    return spawnSync(join(root, "node_modules/.bin/tsc"), options, { cwd: folder, encoding: "utf8" }).stdout.trim();
  };
  for (const modules of [["--module", "nodenext"], ["--module", "preserve", "--moduleResolution", "bundler"]]) {
    assert.equal(check("rmsPx", ...modules), "");
    assert.match(check("rms_px", ...modules), /typed\.ts.*rms_px/);
  }
});

test("publint and are-the-types-wrong find nothing", () => {
  const tool = (name) => join(root, "node_modules/.bin", name);
  execFileSync(tool("publint"), ["--strict", join(folder, "node_modules/gravisight")], { stdio: "pipe" });
  execFileSync(tool("attw"), [installed.tarball, "--profile", "esm-only", "--exclude-entrypoints", "./wasm/*"], { stdio: "pipe" });
});

test("nothing was reported to the console", () => {
  // A browser reports the request by which the package finds out that a build is not there.
  const isOfMissingBuild = (complaint) => without("cpu-relaxed") && /404.*\/wasm\/cpu-(relaxed|threads)\/gravisight\.js$/.test(complaint);
  assert.deepEqual(complaints.filter((complaint) => !isOfMissingBuild(complaint)), []);
});
