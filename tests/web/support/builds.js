/** The browser's builds that are there: `scripts/test` makes the first, and the others where what they are made from has changed. */
import { existsSync, readFileSync } from "node:fs";

const file = (path) => new URL(`../../../${path}`, import.meta.url);
const made = (build) => existsSync(file(`pkg/wasm/${build}/gravisight_bg.wasm`));

export const builds = readFileSync(file("scripts/wasm-builds"), "utf8").trim().split("\n").filter(made);

/** Why a test that needs a build is skipped; false where it is not. */
export const without = (build) => !builds.includes(build) && `no ${build} build: run scripts/build-wasm ${build}`;
