/** The wasm builds. They are assets to a bundler, not modules, so that one of them may be missing. */
import type * as Core from "../wasm/cpu/gravisight.js";
import { GravisightError, gravisightErrorFrom } from "./error.js";
import { fetchBytes, isWebPage, type OnBytes } from "./fetch.js";
import { fileExists, isFile, readFile } from "./node.js";
import type { Source } from "./protocol.js";
import type { ThreadedModule } from "./thread.js";
import { startThreads, threadsInWorker, threadsOf } from "./threads.js";
import { isTrap } from "./trap.js";
import type { CoreOptions, DeviceKind } from "./types.js";
import { absoluteUrl, assetUrl } from "./url.js";

/** What a build offers. All have everything, so one's declarations speak of all; the one for the CPU is always made first. */
export type CoreModule = typeof Core;

/** Those for the CPU come with fused multiply-add ("relaxed SIMD", Chromium 114, Firefox 145), and without; with it also for threads. */
type Build = DeviceKind | "cpu-relaxed" | "cpu-threads";

interface Files {
  build: Build;
  glue: URL;
  wasm: URL;
}

/** `folder` holds the builds where the user put them elsewhere. */
function urlsOf(build: Build, folder: string | undefined): Files {
  if (folder !== undefined) {
    const base = new URL(`${build}/`, folder.endsWith("/") ? folder : `${folder}/`);
    return { build, glue: new URL("gravisight.js", base), wasm: new URL("gravisight_bg.wasm", base) };
  }
  const { glue, wasm } = ownFiles(build);
  return { build, glue: assetUrl(glue), wasm: assetUrl(wasm) };
}

/** Bundlers look for the literal form of each URL. */
function ownFiles(build: Build): Omit<Files, "build"> {
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
    case "cpu-threads":
      return {
        glue: new URL("../wasm/cpu-threads/gravisight.js", import.meta.url),
        wasm: new URL("../wasm/cpu-threads/gravisight_bg.wasm", import.meta.url),
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

/** URLs of the files that this browser fetches for a device: for `<link rel="preload">`, or for a service worker that keeps them. */
export async function coreFiles(device: DeviceKind = "cpu", options: Pick<CoreOptions, "wasm" | "threads"> = {}): Promise<string[]> {
  const source = sourceOf(options);
  const { glue, wasm } = await deployed(device, source.wasm, threadsInWorker(source.threads));
  return [glue.href, wasm.href];
}

/** The first build for a device that was deployed: for the CPU the faster one where the browser can run it. */
async function deployed(kind: DeviceKind, folder: string | undefined, threads: number): Promise<Files> {
  const builds: Build[] = [kind];
  if (kind === "cpu" && WebAssembly.validate(RELAXED)) {
    builds.unshift("cpu-relaxed");
    if (threads > 1) builds.unshift("cpu-threads");
  }
  for (const build of builds) {
    const urls = urlsOf(build, folder);
    // Requested first, because the import of a missing module reports neither status nor reason.
    if (await isScript(urls.glue)) return urls;
  }
  throw missing(kind, urlsOf(kind, folder).glue);
}

/** Where the builds come from, and for how many threads. @throws {@link GravisightError} `threads`. */
export function sourceOf(options: Pick<CoreOptions, "wasm" | "threads" | "worker">): Source {
  const { wasm } = options;
  return { wasm: wasm === undefined ? undefined : absoluteUrl(wasm), threads: threadsOf(options) };
}

/** Those that were started on this thread. */
const started = new Set<CoreModule>();

/** The panic message of a build that trapped, once; empty if none did. */
function lastPanic(): string {
  const messages = [...started].map((module) => {
    try {
      return module.lastPanic();
    } catch {
      return ""; // a core that trapped may not answer
    }
  });
  return messages.find((message) => message !== "") ?? "";
}

/** What was thrown while the core worked, as a {@link GravisightError}; a trap has the message of its panic. */
export function errorOfCore(thrown: unknown): GravisightError {
  return gravisightErrorFrom(thrown, isTrap(thrown) ? lastPanic() : "");
}

/** The builds of this thread, by their glue's URL: a second start would put another memory under the objects of the first. */
const builds = new Map<string, Promise<{ module: CoreModule; bytes: number }>>();

/** Fetches and starts a build, once a thread; `cpu-build-missing` or `webgpu-build-missing` where it is not there. */
export async function loadBuild(kind: DeviceKind, source: Source, onBytes: OnBytes): Promise<CoreModule> {
  const threads = threadsInWorker(source.threads);
  const urls = await deployed(kind, source.wasm, threads);
  const known = builds.get(urls.glue.href);
  const starting = known ?? start(urls, kind, threads, onBytes, () => loadBuild(kind, { ...source, threads: 1 }, onBytes));
  builds.set(urls.glue.href, starting);
  try {
    const { module, bytes } = await starting;
    if (known) onBytes(bytes, bytes);
    started.add(module);
    return module;
  } catch (thrown) {
    // The next one tries again.
    if (builds.get(urls.glue.href) === starting) builds.delete(urls.glue.href);
    throw thrown;
  }
}

async function start(
  { build, glue, wasm }: Files,
  kind: DeviceKind,
  threads: number,
  onBytes: OnBytes,
  withoutThreads: () => Promise<CoreModule>,
): Promise<{ module: CoreModule; bytes: number }> {
  const script = importable(glue);
  const [core, bytes] = await Promise.all([
    script.then((url) => import(/* @vite-ignore */ /* webpackIgnore: true */ url) as Promise<CoreModule>),
    fetchBytes(wasm.href, `the ${nameOf(kind)} build`, onBytes),
  ]);
  if (build !== "cpu-threads") {
    await core.default({ module_or_path: bytes });
  } else {
    const module = await WebAssembly.compile(bytes);
    const { memory } = await core.default({ module_or_path: module });
    try {
      await startThreads(core as ThreadedModule, threads, { glue: await script, module, memory });
    } catch {
      // No Workers in here, by a policy or the browser's age: as it is without.
      return { module: await withoutThreads(), bytes: bytes.length };
    }
  }
  return { module: core, bytes: bytes.length };
}

/**
 * What to import for a build's glue. In Node.js its text: whether a `.js` file counts as a module there is up to the package.json
 * above it, and on the server of a framework (Next.js) the bundler has put it under one that says no.
 */
async function importable(glue: URL): Promise<string> {
  if (!isFile(glue.href)) return glue.href;
  const text = new TextDecoder().decode(await readFile(glue));
  return `data:text/javascript,${encodeURIComponent(`${text}\n//# sourceURL=${glue.href}`)}`;
}

async function isScript(url: URL): Promise<boolean> {
  if (isFile(url.href)) return fileExists(url);
  try {
    const response = await fetch(url);
    return response.ok && !isWebPage(response);
  } catch {
    return false;
  }
}

function missing(kind: DeviceKind, url: URL): GravisightError {
  const hint = isFile(url.href) ? " Has a bundler moved it? Keep this package out of a server's bundle; in Next.js: serverExternalPackages." : "";
  return new GravisightError(`${kind}-build-missing`, `The ${nameOf(kind)} build was not found: ${url.href} is not a script.${hint}`);
}

function nameOf(kind: DeviceKind): string {
  return { cpu: "CPU", webgpu: "WebGPU" }[kind];
}
