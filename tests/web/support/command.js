/** The command, as `cargo test` built it. */
import { execFileSync } from "node:child_process";
import { homedir } from "node:os";
import { join } from "node:path";

export const path = join(process.env.CARGO_TARGET_DIR ?? join(homedir(), ".cache/gravisight/target"), "debug/gravisight");

/** Runs `gravisight` and returns what it prints. */
export function gravisight(args, options) {
  return execFileSync(path, args, { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"], ...options });
}
