/** The wasm builds. They are assets to a bundler, not modules, so that one of them may be missing. */
import { GravisightError } from "./error.js";
import { fetchBytes, isWebPage, type OnBytes } from "./fetch.js";
import type { RawModule } from "./raw.js";
import type { DeviceKind } from "./types.js";

/** The CPU has two: with fused multiply-add ("relaxed SIMD", Chromium 114, Firefox 145), and without. */
type Build = "cpu" | "cpu-relaxed" | "webgpu";

/** Bundlers look for the literal form of each URL. */
function urlsOf(build: Build): { glue: URL; wasm: URL } {
  switch (build) {
    case "cpu":
      return {
        glue: new URL("../wasm/cpu/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/cpu/gravisight_bg.wasm", import.meta.url),
      };
    case "cpu-relaxed":
      return {
        glue: new URL("../wasm/cpu-relaxed/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/cpu-relaxed/gravisight_bg.wasm", import.meta.url),
      };
    case "webgpu":
      return {
        glue: new URL("../wasm/webgpu/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/webgpu/gravisight_bg.wasm", import.meta.url),
      };
  }
}

/** The smallest module with a relaxed instruction (`i8x16.relaxed_swizzle`): who refuses it does not have them. */
const RELAXED = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 15, 1, 13, 0, 65, 1, 253, 15, 65, 2, 253, 15, 253,
  128, 2, 11,
]);

/** The first build for a device that was deployed: for the CPU the faster one where the browser can run it. */
async function deployed(kind: DeviceKind): Promise<{ glue: URL; wasm: URL }> {
  const builds: Build[] = kind === "cpu" && WebAssembly.validate(RELAXED) ? ["cpu-relaxed", "cpu"] : [kind];
  for (const build of builds) {
    const urls = urlsOf(build);
    // Asked for first, because the import of a missing module says neither status nor reason.
    if (await isScript(urls.glue)) return urls;
  }
  throw missing(kind, urlsOf(kind).glue);
}

let started: RawModule | undefined;

/** What the build that was started last said when it trapped; empty if it did not. */
export function lastPanic(): string {
  try {
    return started?.lastPanic() ?? "";
  } catch {
    return ""; // a core that trapped may not answer
  }
}

/** Fetches and starts a build; `cpu-build-missing` or `webgpu-build-missing` where it is not there. */
export async function loadBuild(kind: DeviceKind, onBytes: OnBytes): Promise<RawModule> {
  const { glue, wasm } = await deployed(kind);
  const [module, bytes] = await Promise.all([
    import(/* @vite-ignore */ /* webpackIgnore: true */ glue.href) as Promise<RawModule>,
    fetchBytes(wasm.href, `the ${nameOf(kind)} build`, onBytes),
  ]);
  await module.default({ module_or_path: bytes });
  started = module;
  return module;
}

async function isScript(url: URL): Promise<boolean> {
  try {
    const response = await fetch(url);
    return response.ok && !isWebPage(response);
  } catch {
    return false;
  }
}

function missing(kind: DeviceKind, url: URL): GravisightError {
  return new GravisightError(`${kind}-build-missing`, `The ${nameOf(kind)} build is not here: ${url.href} is not a script.`);
}

export function nameOf(kind: DeviceKind): string {
  return kind === "cpu" ? "CPU" : "WebGPU";
}
