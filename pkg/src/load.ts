/** From a model's URL and a choice of device to a core that is ready. */
import type * as Core from "../wasm/cpu/gravisight.js";
import { errorOfCore, loadBuild, type CoreModule } from "./builds.js";
import { cached, cardText, keep } from "./cache.js";
import { adapterHere, countingTo, faster, keepTimes, keptTimes, measure, reasonOf, requestedDevice, timesKey } from "./device.js";
import { GravisightError } from "./error.js";
import { fetchBytes, mayFetch } from "./fetch.js";
import { ownModel } from "./own.js";
import type { Request } from "./protocol.js";
import { untilTrap } from "./trap.js";
import type { Device, DeviceKind, Model, Progress } from "./types.js";

type OnProgress = (progress: Progress) => void;

export interface Loaded {
  core: Core.Localiser;
  module: CoreModule;
  device: Device;
  model: Model;
}

/** Which model, where from and on what. */
type ModelRequest = Pick<Request<"create">, "model" | "device" | "wasm" | "threads" | "cache">;

/** Takes the device that was chosen; `auto` the faster one, or the CPU where WebGPU is absent or fails, and says why. Works for the engine `of`. */
export async function load(request: ModelRequest, onProgress: OnProgress, of: object): Promise<Loaded> {
  const model = loadModel(request.model, request.cache, onProgress);
  // The build is awaited first; without this, a model that fails meanwhile counts as an unhandled rejection.
  model.catch(() => {});
  const start = async (kind: DeviceKind, reason: string): Promise<Loaded> => {
    const module = await loadBuild(kind, request, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
    const { card, weights } = await model;
    onProgress({ stage: "warming up", loaded: 0, total: null });
    const core = await untilTrap(of, () => module.Localiser.create(card, weights, kind));
    return { core, module, device: deviceOf(core, kind, reason), model: { card, weights } };
  };
  if (request.device !== "auto") {
    const { kind, reason } = await requestedDevice(request.device);
    return start(kind, reason);
  }
  const found = await adapterHere();
  if ("missing" in found) return start("cpu", `auto: ${found.missing}`);
  return fasterOne(start, timesKey((await model).card, found.adapter), request.cache, onProgress, of);
}

/** The device that was chosen, or for `auto` the faster one. */
export async function pickDevice(request: ModelRequest, onProgress: OnProgress, of: object): Promise<Pick<Device, "kind" | "reason">> {
  if (request.device !== "auto") return requestedDevice(request.device);
  const { core, device } = await load(request, onProgress, of);
  core.free();
  return device;
}

/** The model on the faster device: the one that was measured once and kept under `key`, or is measured now. */
async function fasterOne(
  start: (kind: DeviceKind, reason: string) => Promise<Loaded>,
  key: string,
  useCache: boolean,
  onProgress: OnProgress,
  of: object,
): Promise<Loaded> {
  const kept = useCache ? await keptTimes(key) : null;
  const isMeasured = countingTo(onProgress);
  /** A model on a device and how long a picture takes there, or the error if it does not work. Nothing of a failed one is kept. */
  const attempt = async (kind: DeviceKind): Promise<{ loaded: Loaded; ms: number } | { failed: GravisightError }> => {
    let loaded: Loaded | undefined;
    try {
      const made = (loaded = await start(kind, ""));
      return { loaded, ms: await untilTrap(of, () => measure(made.core, isMeasured)) };
    } catch (thrown) {
      const failed = errorOfCore(thrown);
      // After a trap its memory cannot be used, not even to free something.
      if (failed.code !== "internal") loaded?.core.free();
      return { failed };
    }
  };
  if (kept) {
    try {
      return await start(faster(kept), reasonOf(kept, true));
    } catch (thrown) {
      if (faster(kept) === "cpu") throw thrown;
      return start("cpu", `auto: WebGPU failed: ${errorOfCore(thrown).message}`);
    }
  }
  const gpu = await attempt("webgpu");
  if ("failed" in gpu) return start("cpu", `auto: WebGPU failed: ${gpu.failed.message}`);
  const cpu = await attempt("cpu");
  if ("failed" in cpu) return { ...gpu.loaded, device: { ...gpu.loaded.device, reason: `auto: the CPU failed: ${cpu.failed.message}` } };
  const times = { cpu: cpu.ms, webgpu: gpu.ms, day: new Date().toISOString().slice(0, 10) };
  if (useCache) await keepTimes(key, times);
  const [taken, other] = faster(times) === "webgpu" ? [gpu.loaded, cpu.loaded] : [cpu.loaded, gpu.loaded];
  other.core.free();
  return { ...taken, device: { ...taken.device, reason: reasonOf(times, false) } };
}

/** The description of a model's device. */
export function deviceOf({ deviceName, adapter }: Pick<Core.Localiser, "deviceName" | "adapter">, kind: DeviceKind, reason: string): Device {
  return { kind, name: deviceName, reason, ...(adapter && { adapter }) };
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
  // Without a digest (not in a secure context) the core alone checks them.
  if (kept && (await sha256Of(kept)) === sha256) {
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
  if (!mayFetch(href, cardUrl)) throw new GravisightError("fetch", `The model's card ${cardUrl} names weights at ${href}, but a card from a network may only name weights on a network.`);
  return { url: href, sha256: typeof sha256 === "string" ? sha256 : undefined };
}
