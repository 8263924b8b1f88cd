/** The benches that run in a browser start and print what README takes from them. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { fileURLToPath } from "node:url";
import { test } from "node:test";

test("the times in Chromium", () => {
  const bench = fileURLToPath(new URL("../../benches/peers/browser.mjs", import.meta.url));
  const printed = execFileSync("node", [bench, "--check"], { encoding: "utf8" });
  assert.match(printed, /^sd-l +[\d.]+ ms \(CPU .*depth differs by 0e\+0$/m);
});
