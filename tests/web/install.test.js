/** The packed package as users install it: a bundler, no bundler, Node.js, Workers of their own; a strict CSP. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { cpSync, createReadStream, existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { extname, join } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { build } from "vite";
import { launch } from "./support/browser.js";
import { pictureOf, samples } from "./support/demo.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const golden = JSON.parse(readFileSync(new URL("../golden/samples.json", import.meta.url), "utf8"));
const TYPES = { ".js": "text/javascript", ".html": "text/html", ".wasm": "application/wasm", ".json": "application/json" };
/** No inline script, no eval, no blob: what a careful site allows. */
const CSP = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; connect-src 'self'; img-src 'self'";
let folder, browser, server, page;
const complaints = [];

before(async () => {
  folder = mkdtempSync(join(tmpdir(), "gravisight-install-"));
  const packed = join(folder, "packed");
  mkdirSync(packed);
  // The WebGPU build is large and the same code: it is left out here, as a site may.
  execFileSync("npm", ["pack", "--silent", "--pack-destination", packed], { cwd: join(root, "pkg"), stdio: ["ignore", "ignore", "inherit"] });
  const [tarball] = readdirSync(packed);
  mkdirSync(join(folder, "node_modules"));
  execFileSync("tar", ["-xzf", join(packed, tarball), "-C", packed]);
  cpSync(join(packed, "package"), join(folder, "node_modules", "gravisight"), { recursive: true });
  for (const name of ["sd-l.json", "sd-l.safetensors"]) cpSync(join(root, "models", name), join(folder, name));
  writeFileSync(join(folder, "package.json"), JSON.stringify({ name: "app", private: true, type: "module" }));
  writeFileSync(join(folder, "camera.json"), JSON.stringify(samples[0].camera));
  writeFileSync(join(folder, "picture.png"), pictureOf(samples[0]));
  server = createServer(serveFile);
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  browser = await launch({ webgpu: false });
});

after(async () => {
  await browser?.close();
  server?.close();
  if (folder) rmSync(folder, { recursive: true, force: true });
});

function serveFile(request, response) {
  const path = join(folder, decodeURIComponent(new URL(request.url, "http://localhost").pathname));
  if (path.includes("..") || !existsSync(path) || !statSync(path).isFile()) return response.writeHead(404).end();
  response.setHeader("Content-Type", TYPES[extname(path)] ?? "application/octet-stream");
  response.setHeader("Content-Security-Policy", CSP);
  createReadStream(path).pipe(response);
}

/** Opens a page that says the position in its title, and reads it. */
async function positionOn(path) {
  page = await browser.newPage();
  page.on("console", (message) => message.type() === "error" && complaints.push(`${path}: ${message.text()} ${message.location().url}`));
  page.on("pageerror", (error) => complaints.push(`${path}: ${error}`));
  await page.goto(`http://127.0.0.1:${server.address().port}/${path}`);
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
const program = (from, options = "", base = "/") => `
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
const PLAIN = "/node_modules/gravisight/dist/index.js";

test("the tarball holds what it must, and no more", () => {
  const { name, dependencies, sideEffects } = JSON.parse(readFileSync(join(folder, "node_modules/gravisight/package.json"), "utf8"));
  assert.equal(name, "gravisight");
  assert.equal(dependencies, undefined);
  assert.deepEqual(sideEffects, ["./dist/worker.js"]);
  const files = readdirSync(join(folder, "node_modules/gravisight")).sort();
  assert.deepEqual(files, ["LICENSE-APACHE", "LICENSE-MIT", "README.md", "dist", "package.json", "wasm"]);
});

test("without a bundler, under a strict content security policy", async () => {
  writeFileSync(join(folder, "plain.js"), inPage + program(PLAIN));
  writeFileSync(join(folder, "plain.html"), html("/plain.js"));
  isGolden(await positionOn("plain.html"));
});

test("with the wasm in another folder", async () => {
  cpSync(join(folder, "node_modules/gravisight/wasm/cpu"), join(folder, "elsewhere/cpu"), { recursive: true });
  writeFileSync(join(folder, "elsewhere.js"), inPage + program(PLAIN, `, wasm: "/elsewhere"`));
  writeFileSync(join(folder, "elsewhere.html"), html("/elsewhere.js"));
  isGolden(await positionOn("elsewhere.html"));
});

test("on the page's own thread", async () => {
  writeFileSync(join(folder, "inline.js"), inPage + program(PLAIN, ", worker: false"));
  writeFileSync(join(folder, "inline.html"), html("/inline.js"));
  isGolden(await positionOn("inline.html"));
});

test("inside a Worker of the user's, and through one that imports gravisight/worker", async () => {
  writeFileSync(join(folder, "own-worker.js"), `const report = (found) => postMessage(found);${program(PLAIN, ", worker: false")}`);
  writeFileSync(join(folder, "own.js"), `${inPage}new Worker("/own-worker.js", { type: "module" }).onmessage = ({ data }) => report(data);`);
  writeFileSync(join(folder, "own.html"), html("/own.js"));
  isGolden(await positionOn("own.html"));
  writeFileSync(join(folder, "given-worker.js"), `import "/node_modules/gravisight/dist/worker.js"; self.addEventListener("message", ({ data }) => data === "hello" && postMessage("mine"));`);
  writeFileSync(join(folder, "given.js"), `${inPage}const worker = new Worker("/given-worker.js", { type: "module" });${program(PLAIN, ", worker")}`);
  writeFileSync(join(folder, "given.html"), html("/given.js"));
  isGolden(await positionOn("given.html"));
});

test("in a Vite app, with the Worker and the wasm as its assets", { timeout: 120_000 }, async () => {
  const app = join(folder, "vite");
  mkdirSync(join(app, "public"), { recursive: true });
  for (const name of ["sd-l.json", "sd-l.safetensors", "camera.json", "picture.png"]) cpSync(join(folder, name), join(app, "public", name));
  writeFileSync(join(app, "index.html"), html("/main.js"));
  writeFileSync(join(app, "main.js"), inPage + program("gravisight", "", "./"));
  await build({ root: app, base: "./", logLevel: "error", configFile: false, build: { target: "es2022" } });
  isGolden(await positionOn("vite/dist/index.html"));
  assert.ok(!readdirSync(join(app, "dist/assets")).some((name) => name.endsWith(".ts")));
});

test("in Node.js", () => {
  writeFileSync(
    join(folder, "node.js"),
    `import { readFile } from "node:fs/promises";
import { Localiser } from "gravisight";
const localiser = await Localiser.create({ model: "sd-l.json", camera: JSON.parse(await readFile("camera.json", "utf8")) });
console.log(JSON.stringify((await localiser.localise(await readFile("picture.png"))).world));
localiser.dispose();`,
  );
  isGolden(JSON.parse(execFileSync("node", ["node.js"], { cwd: folder })));
});

test("publint and are-the-types-wrong find nothing", () => {
  const tool = (name) => join(root, "node_modules/.bin", name);
  execFileSync(tool("publint"), ["--strict", join(folder, "node_modules/gravisight")], { stdio: "pipe" });
  const [tarball] = readdirSync(join(folder, "packed")).filter((name) => name.endsWith(".tgz"));
  execFileSync(tool("attw"), [join(folder, "packed", tarball), "--profile", "esm-only", "--exclude-entrypoints", "./wasm/*"], { stdio: "pipe" });
});

test("nothing was reported to the console", () => {
  assert.deepEqual(complaints, []);
});
