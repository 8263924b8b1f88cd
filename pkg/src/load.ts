/** From a model's URL and a choice of device to a core that is ready. */
import type * as Core from "../wasm/cpu/gravisight.js";
import { lastPanic, loadBuild, nameOf, type CoreModule } from "./builds.js";
import { cached, cardText, keep } from "./cache.js";
import { GravisightError, gravisightErrorFrom } from "./error.js";
import { fetchBytes, mayFetch } from "./fetch.js";
import { ownModel } from "./own.js";
import type { Request } from "./protocol.js";
import { untilTrap } from "./trap.js";
import type { Device, DeviceChoice, DeviceKind, Model, Progress } from "./types.js";

type OnProgress = (progress: Progress) => void;

export interface Loaded {
  core: Core.Localiser;
  module: CoreModule;
  device: Device;
  model: Model;
}

/** Takes the device that was chosen; `auto` takes the CPU where WebGPU is absent or fails, and says why. Works for the engine `of`. */
export async function load(request: Request<"create">, onProgress: OnProgress, of: object): Promise<Loaded> {
  const model = loadModel(request.model, request.cache, onProgress);
  // The build is awaited first; without this, a model that fails meanwhile counts as an unhandled rejection.
  model.catch(() => {});
  const { kind, reason } = await pickDevice(request.device);
  const start = async (kind: DeviceKind, reason: string): Promise<Loaded> => {
    const module = await loadBuild(kind, request.wasm, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
    const { card, weights } = await model;
    onProgress({ stage: "warming up", loaded: 0, total: null });
    const core = await untilTrap(of, () => module.Localiser.create(card, weights, kind));
    return { core, module, device: { kind, name: core.deviceName || nameOf(kind), reason }, model: { card, weights } };
  };
  try {
    return await start(kind, reason);
  } catch (thrown) {
    if (kind === "cpu" || request.device !== "auto") throw thrown;
    return start("cpu", `auto: WebGPU failed: ${gravisightErrorFrom(thrown, lastPanic()).message}`);
  }
}

/** The device to try first, and why. */
export async function pickDevice(choice: DeviceChoice): Promise<{ kind: DeviceKind; reason: string }> {
  if (choice === "cpu") return { kind: "cpu", reason: "as asked for" };
  const noAdapter = await whyNoAdapter();
  if (choice === "auto") {
    return noAdapter ? { kind: "cpu", reason: `auto: ${noAdapter}` } : { kind: "webgpu", reason: "auto: this browser has a WebGPU adapter" };
  }
  if (noAdapter) throw new GravisightError("webgpu-no-adapter", `WebGPU cannot be used: ${noAdapter}.`);
  return { kind: "webgpu", reason: "as asked for" };
}

/**
 * The card and its weights, which are kept by their sha256 where `useCache` says so; a model in memory as it is; without
 * one the package's own.
 */
export async function loadModel(model: string | Model | undefined, useCache: boolean, onProgress: OnProgress): Promise<Model> {
  if (model === undefined) {
    const { card, weights } = ownModel();
    return fetchModel(card, useCache, onProgress, weights);
  }
  return typeof model === "string" ? fetchModel(model, useCache, onProgress) : model;
}

async function fetchModel(cardUrl: string, useCache: boolean, onProgress: OnProgress, weightsUrl?: string): Promise<Model> {
  const card = await cardText(cardUrl, useCache);
  const { url: named, sha256 } = weightsOf(cardUrl, card);
  const url = weightsUrl ?? named;
  const kept = useCache && sha256 ? await cached(sha256) : null;
  if (kept) {
    onProgress({ stage: "weights", loaded: kept.length, total: kept.length });
    return { card, weights: kept };
  }
  const weights = await fetchBytes(url, "the weights", (loaded, total) => onProgress({ stage: "weights", loaded, total }));
  // What is not what the card says is refused by the core, and must not be found again the next time.
  if (useCache && sha256 && sha256 === (await sha256Of(weights))) await keep(sha256, weights);
  return { card, weights };
}

async function sha256Of(bytes: Uint8Array<ArrayBuffer>): Promise<string | undefined> {
  const digest = await globalThis.crypto?.subtle?.digest("SHA-256", bytes);
  return digest && Array.from(new Uint8Array(digest), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** The card names its weights; the core checks everything else in it. */
function weightsOf(cardUrl: string, card: string): { url: string; sha256: string | undefined } {
  let content: { weights?: unknown; sha256?: unknown } | null;
  try {
    content = JSON.parse(card) as typeof content;
  } catch (thrown) {
    throw new GravisightError("card-json", `The model's card ${cardUrl} is not JSON.`, { cause: thrown });
  }
  const { weights, sha256 } = content ?? {};
  const file = typeof weights === "string" && weights !== "" ? weights : cardUrl.replace(/\.json(?=$|[?#])/, ".safetensors");
  const { href } = new URL(file, cardUrl);
  if (!mayFetch(href, cardUrl)) throw new GravisightError("fetch", `The model's card ${cardUrl} names weights at ${href}, which is not on a network as the card is.`);
  return { url: href, sha256: typeof sha256 === "string" ? sha256 : undefined };
}

/** Null where this thread has a WebGPU adapter. The DOM's types do not know WebGPU in every version. */
async function whyNoAdapter(): Promise<string | null> {
  const gpu = (globalThis.navigator as { gpu?: { requestAdapter(): Promise<unknown> } } | undefined)?.gpu;
  if (!gpu) return "this browser has no WebGPU";
  try {
    return (await gpu.requestAdapter()) ? null : "no WebGPU adapter in this browser";
  } catch (thrown) {
    return `this browser refused a WebGPU adapter (${gravisightErrorFrom(thrown).message})`;
  }
}
