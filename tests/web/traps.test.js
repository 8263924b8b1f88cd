/** What becomes of everybody's work and memory where the core, a device or a listener fails: in Node.js, with builds that fail as they are told. */
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { afterEach, beforeEach, test } from "node:test";
import { Localiser } from "gravisight";
import { isTrap, untilTrap, watchForTraps } from "../../pkg/dist/trap.js";
import { samples } from "./support/demo.js";
import { STUB_MODEL, writeStubBuilds } from "./support/stub-builds.js";

const { camera } = samples[0];
const trap = () => new WebAssembly.RuntimeError("unreachable");
const failure = (code) => Object.assign(new Error("the device is lost"), { name: "GravisightError", code });
const fail = (thrown) => () => {
  throw thrown;
};
/** Node.js 20 has relaxed SIMD behind a switch: this machine's build for one thread may be either. */
const CPUS = ["cpu", "cpu-relaxed"];
const navigator = Object.getOwnPropertyDescriptor(globalThis, "navigator");
let freed;

beforeEach(() => {
  freed = [];
  globalThis.stub = Object.fromEntries([...CPUS, "webgpu"].map((build) => [build, { free: () => freed.push(CPUS.includes(build) ? "cpu" : build) }]));
  Object.defineProperty(globalThis, "navigator", { configurable: true, value: { gpu: { requestAdapter: async () => ({ limits: {} }) } } });
});

afterEach(() => {
  delete globalThis.stub;
  delete globalThis.navigator;
  if (navigator) Object.defineProperty(globalThis, "navigator", navigator);
});

const onCpu = (does) => CPUS.forEach((build) => Object.assign(globalThis.stub[build], does));
/** With builds of its own: those that were started stay. */
const create = (options) => Localiser.create({ wasm: `file://${writeStubBuilds()}/`, model: STUB_MODEL, camera, ...options });

/** What it held is freed behind its last call. */
async function disposed(localiser) {
  localiser.dispose();
  await new Promise((resolve) => setTimeout(resolve));
  freed = [];
}

test("a trap ends all work under way with one error, and an error of the user's own ends nothing", async () => {
  const scope = new EventTarget();
  let made = 0;
  watchForTraps(scope, (thrown) => Object.assign(new Error(`the core: ${thrown.message}`), { number: ++made }));
  const throwOf = (type, thrown) => {
    const event = Object.assign(new Event(type, { cancelable: true }), type === "error" ? { error: thrown } : { reason: thrown });
    scope.dispatchEvent(event);
    return event.defaultPrevented;
  };
  const works = [{}, {}].map((of) => untilTrap(of, () => new Promise(() => {})).catch((thrown) => thrown));
  for (const type of ["error", "unhandledrejection"]) assert.equal(throwOf(type, new TypeError("mine")), false);
  assert.equal(await Promise.race([...works, "still at work"]), "still at work");
  assert.equal(throwOf("unhandledrejection", trap()), true);
  const [one, other] = await Promise.all(works);
  assert.equal(one, other);
  assert.match(one.message, /unreachable/);
  assert.equal(made, 1);
});

test("a stack that is full is a trap, too, if it is WebAssembly's", () => {
  // (func (export "f") call 0)
  const endless = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 4, 1, 96, 0, 0, 3, 2, 1, 0, 7, 5, 1, 1, 102, 0, 0, 10, 6, 1, 4, 0, 16, 0, 11]);
  const { f } = new WebAssembly.Instance(new WebAssembly.Module(endless)).exports;
  const thrownBy = (work) => {
    try {
      work();
    } catch (thrown) {
      return thrown;
    }
  };
  const own = () => own();
  assert.ok(isTrap(thrownBy(f)));
  assert.ok(!isTrap(thrownBy(own)));
  assert.ok(!isTrap(new RangeError("mine")) && !isTrap("mine") && !isTrap(undefined));
});

test("a panic's words are told of its trap alone", async () => {
  const words = ["panicked at src/lib.rs: a bug"];
  onCpu({ lastPanic: () => words.pop(), create: fail(trap()) });
  await assert.rejects(create(), { code: "internal", message: /a bug/ });
  // Nobody asks for these words, and a later failure is another one.
  words.push("panicked at src/lib.rs: another bug");
  onCpu({ create: fail(new TypeError("not a function")) });
  await assert.rejects(create(), (thrown) => thrown.code === "internal" && /not a function/.test(thrown.message) && !/bug/.test(thrown.message));
});

for (const where of ["create", "measure"]) {
  test(`auto takes WebGPU where the CPU fails to ${where}, and nothing of the CPU is kept`, async () => {
    onCpu({ [where]: fail(failure("value")) });
    const localiser = await create({ device: "auto", cache: false });
    assert.equal(localiser.device.kind, "webgpu");
    assert.match(localiser.device.reason, /the CPU failed: the device is lost/);
    assert.deepEqual(freed, where === "measure" ? ["cpu"] : []);
    localiser.dispose();
  });
}

test("auto takes the CPU where WebGPU fails while it is measured, and gives its memory back unless it trapped", async () => {
  for (const [thrown, left] of [[failure("device"), ["webgpu"]], [trap(), []]]) {
    globalThis.stub.webgpu.measure = fail(thrown);
    const localiser = await create({ device: "auto", cache: false });
    assert.match(localiser.device.reason, /WebGPU failed/);
    assert.deepEqual(freed, left);
    await disposed(localiser);
  }
});

test("a device that fails while in use gives its memory back unless it trapped", async () => {
  for (const [thrown, left] of [[failure("device"), ["webgpu"]], [trap(), []]]) {
    globalThis.stub.webgpu.localise = fail(thrown);
    const localiser = await create({ device: "webgpu" });
    const { device } = await localiser.localise(new Uint8Array(1));
    assert.equal(device.kind, "cpu");
    assert.deepEqual(freed, left);
    await disposed(localiser);
  }
});

test("a listener hears nothing after an abort, and its own error is no error of the core", async () => {
  const controller = new AbortController();
  const heard = [];
  const creating = create({ signal: controller.signal, onProgress: ({ stage }) => (heard.push(stage), controller.abort(new Error("mine"))) });
  await assert.rejects(creating, /mine/);
  await new Promise((resolve) => setTimeout(resolve, 50));
  assert.equal(heard.length, 1);

  const uncaught = [];
  const others = process.listeners("uncaughtException");
  process.removeAllListeners("uncaughtException");
  process.on("uncaughtException", (thrown) => uncaught.push(thrown.message));
  try {
    const localiser = await create({ onProgress: fail(new Error("the listener's")) });
    await new Promise((resolve) => setTimeout(resolve, 10));
    assert.ok(uncaught.length > 0 && uncaught.every((message) => message === "the listener's"), `${uncaught}`);
    localiser.dispose();
  } finally {
    process.removeAllListeners("uncaughtException");
    for (const listener of others) process.on("uncaughtException", listener);
  }
});

test("a thread that traps rejects what waits for it, and the program goes on", () => {
  const script = `
    import { Localiser } from ${JSON.stringify(new URL("../../pkg/dist/index.js", import.meta.url).href)};
    const create = () => Localiser.create({ threads: 2, wasm: "file://${writeStubBuilds()}/", model: { card: "{}", weights: new Uint8Array(1) } });
    for (let times = 0; times < 2; times++) console.log(await create().then(() => "made", ({ code, message }) => code + ": " + message));`;
  const flags = process.versions.node.startsWith("20.") ? ["--experimental-wasm-relaxed-simd"] : [];
  const { status, signal, stdout, stderr } = spawnSync(process.execPath, [...flags, "--input-type=module", "-e", script], { encoding: "utf8", timeout: 20_000 });
  assert.deepEqual([status, signal], [0, null], stderr);
  assert.equal(stdout, "internal: A thread of the core failed: panicked: out of memory\n".repeat(2));
});
