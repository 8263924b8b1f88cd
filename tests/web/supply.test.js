/** What the packages are built from: known licences, the public registries alone, checksums, no scripts that run when installed. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("../..", import.meta.url));
const text = (file) => readFileSync(`${root}/${file}`, "utf8");

/** Licences whose works may be part of what we give away under MIT or Apache-2.0; those that ask for more than a notice are not among them. */
const KNOWN = ["MIT", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "0BSD", "BlueOak-1.0.0", "BSL-1.0", "ISC", "Unicode-3.0", "Unlicense", "Zlib"];
/** Asks that its own files stay under it; those of ours' parts are used as they are. */
const UNCHANGED = "MPL-2.0";
/** Most packages that are installed to build and test the page. */
const MOST_NPM = 250;

/** Whether an SPDX expression of `OR` and `AND` can be met by known licences alone. */
function known(expression) {
  return expression
    .replace(/[()]/g, "")
    .split(" AND ")
    .every((part) => part.split(" OR ").some((licence) => KNOWN.includes(licence.trim()) || licence.trim() === UNCHANGED));
}

test("licences are told from one another", () => {
  for (const fine of ["MIT", "(MIT OR Apache-2.0) AND Unicode-3.0", "GPL-3.0-only OR MIT"]) assert.ok(known(fine), fine);
  for (const wrong of ["GPL-3.0-only", "MIT AND GPL-3.0-only", "unknown", "LGPL-2.1"]) assert.ok(!known(wrong), wrong);
});

test("whatever makes, packs or publishes the browser's builds takes them from one list", () => {
  const builds = text("scripts/wasm-builds").trim().split("\n");
  const shipped = JSON.parse(text("pkg/package.json")).files.map((file) => file.match(/^wasm\/(.*)\/gravisight_bg\.wasm$/)?.[1]);
  assert.deepEqual(shipped.filter(Boolean), builds);
  const cases = [...text("pkg/src/builds.ts").matchAll(/case "(.*)":/g)].map(([, build]) => build);
  assert.deepEqual(cases, builds);
  for (const build of builds) assert.match(text("scripts/build-wasm"), new RegExp(`^  ${build}\\)`, "m"), build);
  // A list of their own, however short, would fall behind.
  for (const file of [".github/workflows/release.yml", "scripts/release", "scripts/torture"]) {
    assert.doesNotMatch(text(file), /cpu-relaxed/, file);
    assert.match(text(file), /scripts\/build-wasm all/, file);
  }
  // In an order of their own, so that builds share what is compiled.
  const made = [...text("scripts/demo").matchAll(/scripts\/build-wasm ([a-z-]+)/g)].map(([, build]) => build);
  assert.deepEqual([...new Set(made)].sort(), [...builds].sort());
  assert.match(text("scripts/test"), /done <scripts\/wasm-builds/);
  // All of them are tested once a week and before a release.
  for (const file of [".github/workflows/test.yml", ".github/workflows/release.yml"]) assert.match(text(file), /scripts\/test .*--all/, file);
  // The crates are published from the tree that the release prepared.
  assert.match(text(".github/workflows/release.yml"), /cargo publish .*--manifest-path \.\.\/release-source\/Cargo\.toml/);
  assert.match(text("scripts/release"), /-source`/);
});

for (const which of ["cargo", "npm"]) {
  test(`every part of the ${which} package has a known licence and a checksum`, () => {
    const quiet = { encoding: "utf8", maxBuffer: 2 ** 28, stdio: ["ignore", "pipe", "ignore"] };
    const { components } = JSON.parse(execFileSync("node", [`${root}/scripts/sbom`, which], quiet));
    assert.ok(components.length > 100, `${components.length} parts`);
    for (const { name, version, licenses, hashes } of components.filter((part) => part.name !== "gravisight")) {
      assert.ok(licenses.every(({ expression }) => expression && known(expression)), `${name} ${version}: ${JSON.stringify(licenses)}`);
      assert.ok(hashes?.[0].content.match(/^[0-9a-f]{64}$/), `${name} ${version} has no checksum`);
    }
  });
}

test("crates come from crates.io and npm packages from a registry, whole; none runs a script when it is installed", () => {
  const sources = [...text("Cargo.lock").matchAll(/^source = "(.*)"$/gm)].map(([, source]) => source);
  assert.ok(sources.length > 200);
  assert.deepEqual([...new Set(sources)], ["registry+https://github.com/rust-lang/crates.io-index"]);
  const packages = Object.entries(JSON.parse(text("package-lock.json")).packages).filter(([path, it]) => path.startsWith("node_modules/") && !it.link);
  assert.ok(packages.length < MOST_NPM, `${packages.length} packages`);
  for (const [path, it] of packages) {
    assert.match(it.integrity ?? "", /^sha512-/, `${path} has no checksum`);
    assert.ok(!it.resolved || it.resolved.startsWith("https://registry.npmjs.org/"), `${path} comes from ${it.resolved}`);
    assert.ok(!it.hasInstallScript || it.optional, `${path} runs a script when it is installed`);
    assert.ok(it.license && known(it.license), `${path}: ${it.license}`);
  }
});

test("what makes the documentation is whole, may be used, and runs no script when it is installed", () => {
  // Parts of its tools that we use and do not give away: a parser of arguments, and icons.
  const asked = ["Python-2.0", "CC0-1.0"];
  const packages = Object.entries(JSON.parse(text("site/package-lock.json")).packages).filter(([path]) => path);
  assert.ok(packages.length > 100);
  for (const [path, it] of packages) {
    assert.match(it.integrity ?? "", /^sha512-/, `${path} has no checksum`);
    assert.equal(it.resolved, undefined, `${path} comes from ${it.resolved}`);
    assert.ok(it.license && (known(it.license) || asked.includes(it.license)), `${path}: ${it.license}`);
  }
  assert.match(text("site/.npmrc"), /^ignore-scripts=true$/m);
});
