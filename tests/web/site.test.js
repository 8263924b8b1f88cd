/** The documentation: commands as they stand in its pages, and the site that `scripts/docs` built of them. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { delimiter, dirname, join, relative } from "node:path";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { Toolbox } from "gravisight";
import { axe, launch } from "./support/browser.js";
import { gravisight, path as command } from "./support/command.js";
import { serveFolder } from "./support/server.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const site = join(root, "site/dist");
const markdown = ["", "docs", "models", "pkg"].flatMap((folder) =>
  readdirSync(join(root, folder))
    .filter((file) => file.endsWith(".md"))
    .map((file) => join(folder, file)),
);
/** Sees the free-throw line and the ring of a basketball court from the side. */
const HALL = {
  width: 1920,
  height: 1080,
  intrinsic: [[1500, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]],
  camera_from_world: [[0, 1, 0, 10], [0, 0, -1, 2.5], [-1, 0, 0, 9], [0, 0, 0, 1]],
};
/** Pages whose named blocks are run in this order. */
const GUIDES = ["docs/cameras.md", "docs/recipes.md", "docs/your-own-ball.md", "docs/many-videos.md"];
/** Blocks that need more than this machine; `cli/tests/all/batch.rs` runs that of GNU parallel. */
const CLUSTERS = ["parallel", "slurm", "kubernetes"];
const complaints = [];
let folder, server, browser;

before(async () => {
  assert.ok(existsSync(join(site, "index.html")), "site/dist is not there: run `scripts/docs` first");
  folder = mkdtempSync(join(tmpdir(), "gravisight-recipes-"));
  server = await serveFolder(site);
  browser = await launch({ webgpu: false });
});

after(async () => {
  await browser?.close();
  server?.close();
  if (folder) rmSync(folder, { recursive: true, force: true });
});

/** The blocks of a page that have a name after their language: name, language, text. */
function blocksOf(page) {
  const text = readFileSync(join(root, page), "utf8");
  return [...text.matchAll(/^```(\w+) (\S+)\n(.*?)^```$/gms)].map(([, language, name, code]) => ({ language, name, code }));
}

/** Runs a block as it stands, and returns what it prints. */
function run({ language, name, code }) {
  if (language !== "sh") return writeFileSync(join(folder, name), code);
  const env = { ...process.env, PATH: dirname(command) + delimiter + process.env.PATH };
  return execFileSync("bash", ["-euo", "pipefail", "-c", code], { cwd: folder, env, encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
}

/** A 2D track of a throw, drawn by the laws of motion: what a tracker of the reader's own would write. */
async function throwAt(scene) {
  const times = Array.from({ length: 50 }, (_, frame) => frame / 50);
  const toolbox = await Toolbox.create();
  const { states } = await toolbox.forecast(scene, { position: [0, -8.2, 2.1], velocity: [0, -4.5, 6] }, times);
  const seen = await toolbox.project(HALL, states.map((state) => state.slice(0, 3)));
  toolbox.dispose();
  return `Frame,Visibility,X,Y\n${seen.map(([x, y], frame) => `${frame},1,${x},${y}`).join("\n")}\n`;
}

test("who starts here gets a position and a flight, and each recipe does what it says", async () => {
  const [films, picture, video] = blocksOf("docs/start.md");
  run(films);
  const [, ...truth] = readFileSync(join(folder, "footage/toss-000.truth.csv"), "utf8").split("\n");
  const expected = truth.map((line) => line.split(",")).find(([frame]) => frame === "30").slice(6).map(Number);
  const world = run(picture).match(/world +x +(\S+) +y +(\S+) +z +(\S+)/).slice(1).map(Number);
  assert.ok(Math.hypot(...world.map((value, axis) => value - expected[axis])) < 0.15, `${world} is not ${expected}`);
  assert.match(run(video), /^explained: 1 flight/);

  const said = new Map();
  for (const block of GUIDES.flatMap(blocksOf).filter(({ name }) => !CLUSTERS.includes(name))) {
    if (block.name === "fit") {
      writeFileSync(join(folder, "hall-camera.json"), JSON.stringify(HALL));
      writeFileSync(join(folder, "throw.csv"), await throwAt(JSON.parse(readFileSync(join(folder, "hall.json"), "utf8"))));
    }
    said.set(block.name, run(block));
  }
  assert.match(said.get("camera"), /4 points, 0\.0\d px rms/);
  assert.match(said.get("serve"), /\d+ ± \d+ km\/h/);
  assert.match(said.get("toss"), /flight 1: .* starts at 4\.\d+ ± 0\.\d+ m\/s/);
  assert.match(said.get("in"), /within_lines: (1|0\.9\d*),\s+explained: true/);
  assert.match(said.get("throw"), /1\.0000 +0\.0+ +-12\.\d+ +[23]\.\d+/);
  assert.match(said.get("fit"), /flight 1: /);
  assert.match(said.get("ball"), /confidence 0\.\d+[^]*explained: 1 flight/);
  assert.equal(said.get("batch").match(/"status":"done"/g).length, 2);
  assert.equal(said.get("match").match(/"status":"done"/g).length, 1);
  assert.match(said.get("paper"), /DtG /);
  assert.match(said.get("label"), /label/);
});

test("every option that the documentation names is one", () => {
  const known = new Map();
  const helpOf = (subcommand) => known.get(subcommand) ?? known.set(subcommand, gravisight([...subcommand.split(" "), "--help"])).get(subcommand);
  let options = 0;
  for (const page of markdown) {
    const text = readFileSync(join(root, page), "utf8").replaceAll(/\\\n\s*/g, "");
    for (const [line, subcommand, rest] of text.matchAll(/^(?:srun )?gravisight (camera import|[a-z]+)([^\n]*)$/gm)) {
      const own = subcommand === "batch" ? rest.split(" -- ")[0] : rest;
      for (const [option] of own.matchAll(/(?<= )--[a-z][a-z-]*/g)) {
        options += 1;
        assert.ok(helpOf(subcommand).includes(option), `${page}: \`${subcommand}\` has no ${option}: ${line}`);
      }
    }
  }
  assert.ok(options > 100, `${options} options`);
});

/** All built pages, by their path within the site. */
function pagesOf(from = site) {
  return readdirSync(from, { withFileTypes: true }).flatMap((each) => {
    const path = join(from, each.name);
    return each.isDirectory() ? pagesOf(path) : each.name.endsWith(".html") ? [relative(site, path)] : [];
  });
}

test("every markdown file is a page, and every link of the site leads to a page and its heading", () => {
  const html = new Map(pagesOf().map((page) => [page, readFileSync(join(site, page), "utf8")]));
  const listed = html.get("docs/start.html");
  for (const file of markdown) {
    const page = file.replace(/README\.md$/, "index.html").replace(/\.md$/, ".html");
    assert.ok(html.has(page), `${file} is no page`);
    assert.ok(listed.includes(`href="/${page.replace(/index\.html$/, "")}"`), `${file} is not in the list of pages`);
  }
  const wrong = [];
  let links = 0;
  for (const [page, text] of html) {
    if (page.startsWith("api/") || page === "404.html") continue;
    for (const [, href] of text.matchAll(/<a [^>]*?href="([^"]*)"/g)) {
      if (/^(https?:|mailto:)/.test(href)) continue;
      links += 1;
      const url = new URL(href, `http://site/${page}`);
      const target = url.pathname.slice(1).replace(/(^|\/)$/, "$1index.html");
      const id = decodeURIComponent(url.hash.slice(1));
      if (!html.has(target) || (id && !html.get(target).includes(`id="${id}"`))) wrong.push(`${page}: ${href}`);
    }
  }
  assert.deepEqual(wrong, []);
  assert.ok(links > 300, `${links} links`);
});

for (const colorScheme of ["light", "dark"]) {
  test(`the site is read on a phone, and passes axe, ${colorScheme}`, { timeout: 120_000 }, async () => {
    const page = await browser.newPage({ viewport: { width: 390, height: 844 }, colorScheme });
    page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
    page.on("pageerror", (error) => complaints.push(String(error)));
    for (const path of ["index.html", "docs/start.html", "docs/how-it-works.html", "docs/recipes.html", "docs/formats.html", "docs/troubleshooting.html", "api/js/index.html"]) {
      await page.goto(server.url + path);
      await page.waitForLoadState("networkidle");
      assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `${path} scrolls sideways`);
      if (path.startsWith("api/")) continue;
      const background = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
      assert.equal(background === "rgb(255, 255, 255)", colorScheme === "light", background);
      assert.deepEqual(await axe(page, "main", ["wcag2a", "wcag2aa"]), [], path);
    }
    await page.close();
    assert.deepEqual(complaints, []);
  });
}
