/** Builds of the core in which nothing but what a test says happens: traps, failures and what becomes of memory, without compiling anything. */
import { mkdirSync, mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

/** The smallest module. */
const WASM = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0]);

/** A model in memory, for such a build. */
export const STUB_MODEL = { card: '{ "sha256": "00" }', weights: new Uint8Array(1) };

/** What a build does is up to `globalThis.stub[build]`: functions by name. */
const plain = (build) => `
  const call = (name, ...given) => globalThis.stub?.[${JSON.stringify(build)}]?.[name]?.(...given);
  export default async () => (call("start"), {});
  export const lastPanic = () => call("lastPanic") ?? "";
  export class Localiser {
    static async create(...given) { await call("create", ...given); return new Localiser(); }
    async measure() { return (await call("measure")) ?? 1; }
    async localise() { await call("localise"); return { world: [0, 0, 0] }; }
    free() { call("free"); }
    get deviceName() { return ${JSON.stringify(build)}; }
  }`;

/** Its first thread waits for its second, which traps. */
const THREADED = `
  let memory;
  export default async ({ memory: given }) => ({ memory: (memory = given ?? new WebAssembly.Memory({ initial: 1, maximum: 1, shared: true })) });
  const cells = () => new Int32Array(memory.buffer);
  export const lastPanic = () => "panicked: out of memory";
  export const startThreads = () => {};
  export const runThread = () => { Atomics.wait(cells(), 0, 0); throw new WebAssembly.RuntimeError("unreachable"); };
  export class Localiser {
    static async create() { Atomics.store(cells(), 0, 1); Atomics.notify(cells(), 0); Atomics.wait(cells(), 1, 0); }
  }`;

/** Writes the builds to a folder: `wasm` of a `create`. */
export function writeStubBuilds(folder = mkdtempSync(join(tmpdir(), "gravisight-stub-"))) {
  for (const build of ["cpu", "cpu-relaxed", "cpu-threads", "webgpu"]) {
    mkdirSync(join(folder, build), { recursive: true });
    writeFileSync(join(folder, build, "gravisight.js"), build === "cpu-threads" ? THREADED : plain(build));
    writeFileSync(join(folder, build, "gravisight_bg.wasm"), WASM);
  }
  return folder;
}
