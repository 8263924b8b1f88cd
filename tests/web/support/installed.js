/** The packed package, in a folder of its own, as users install it. */
import { execFileSync } from "node:child_process";
import { cpSync, mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("../../..", import.meta.url));

/** Packs the package and installs it. */
export function install() {
  const folder = mkdtempSync(join(tmpdir(), "gravisight-installed-"));
  const packed = join(folder, "packed");
  const installed = join(folder, "node_modules/gravisight");
  for (const each of [packed, installed]) mkdirSync(each, { recursive: true });
  execFileSync("npm", ["pack", "--silent", "--pack-destination", packed], { cwd: join(root, "pkg"), stdio: ["ignore", "ignore", "inherit"] });
  const tarball = join(packed, readdirSync(packed)[0]);
  execFileSync("tar", ["-xzf", tarball, "--strip-components=1", "-C", installed]);
  writeFileSync(join(folder, "package.json"), JSON.stringify({ name: "app", private: true, type: "module" }));
  return { folder, tarball, remove: () => rmSync(folder, { recursive: true, force: true }) };
}

/** Copies a published model into a folder. */
export function copyModel(folder) {
  mkdirSync(folder, { recursive: true });
  for (const name of ["sd-l.json", "sd-l.safetensors"]) cpSync(join(root, "models", name), join(folder, name));
}
