/** The two wasm builds. They are assets to a bundler, not modules, so that one of them may be missing. */
import { GravisightError } from "./error.js";
import { fetchBytes, isWebPage, type OnBytes } from "./fetch.js";
import type { RawModule } from "./raw.js";
import type { DeviceKind } from "./types.js";

/** Bundlers look for the literal form of each URL. */
function urlsOf(kind: DeviceKind): { glue: URL; wasm: URL } {
  return kind === "cpu"
    ? {
        glue: new URL("../wasm/cpu/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/cpu/gravisight_bg.wasm", import.meta.url),
      }
    : {
        glue: new URL("../wasm/webgpu/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/webgpu/gravisight_bg.wasm", import.meta.url),
      };
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
  const { glue, wasm } = urlsOf(kind);
  // Asked for first, because the import of a missing module says neither status nor reason.
  if (!(await isScript(glue))) throw missing(kind, glue);
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
