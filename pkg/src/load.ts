/** From a model's URL and a choice of device to a core that is ready. Runs in the Worker. */
import { lastPanic, loadBuild, nameOf } from "./builds.js";
import { GravisightError, gravisightErrorFrom } from "./error.js";
import { fetchBytes, fetchOk } from "./fetch.js";
import type { RawLocaliser } from "./raw.js";
import { untilTrap } from "./trap.js";
import type { Device, DeviceChoice, DeviceKind, Progress } from "./types.js";

type OnProgress = (progress: Progress) => void;

interface Model {
  card: string;
  weights: Uint8Array;
}

export interface Loaded {
  core: RawLocaliser;
  device: Device;
}

/** Takes the device that was chosen; `auto` takes the CPU where WebGPU is absent or fails, and says why. */
export async function load(cardUrl: string, choice: DeviceChoice, onProgress: OnProgress): Promise<Loaded> {
  const model = fetchModel(cardUrl, onProgress);
  // The build is awaited first; without this, a model that fails meanwhile counts as an unhandled rejection.
  model.catch(() => {});
  if (choice === "cpu") return start("cpu", model, "as asked for", onProgress);
  const noAdapter = await whyNoAdapter();
  if (choice === "webgpu") {
    if (noAdapter) throw new GravisightError("webgpu-no-adapter", `WebGPU cannot be used: ${noAdapter}.`);
    return start("webgpu", model, "as asked for", onProgress);
  }
  if (noAdapter) return start("cpu", model, `auto: ${noAdapter}`, onProgress);
  try {
    return await start("webgpu", model, "auto: this browser has a WebGPU adapter", onProgress);
  } catch (thrown) {
    const why = gravisightErrorFrom(thrown, lastPanic());
    return start("cpu", model, `auto: WebGPU failed: ${why.message}`, onProgress);
  }
}

async function start(kind: DeviceKind, model: Promise<Model>, reason: string, onProgress: OnProgress): Promise<Loaded> {
  const build = await loadBuild(kind, (loaded, total) => onProgress({ stage: "wasm", loaded, total }));
  const { card, weights } = await model;
  onProgress({ stage: "warming up", loaded: 0, total: null });
  const core = await untilTrap(() => build.Localiser.create(card, weights, kind));
  return { core, device: { kind, name: core.deviceName || nameOf(kind), reason } };
}

async function fetchModel(cardUrl: string, onProgress: OnProgress): Promise<Model> {
  const card = await (await fetchOk(cardUrl, "the model's card")).text();
  const weights = await fetchBytes(weightsUrl(cardUrl, card), "the weights", (loaded, total) =>
    onProgress({ stage: "weights", loaded, total }),
  );
  return { card, weights };
}

/** The card names its weights; the core checks everything else in it. */
function weightsUrl(cardUrl: string, card: string): string {
  let content: unknown;
  try {
    content = JSON.parse(card);
  } catch (thrown) {
    throw new GravisightError("card-json", `The model's card ${cardUrl} is not JSON.`, { cause: thrown });
  }
  const name = (content as { weights?: unknown } | null)?.weights;
  const file = typeof name === "string" && name !== "" ? name : cardUrl.replace(/\.json(?=$|[?#])/, ".safetensors");
  return new URL(file, cardUrl).href;
}

/** Null where this Worker has a WebGPU adapter. The DOM's types do not know WebGPU in every version. */
async function whyNoAdapter(): Promise<string | null> {
  const { gpu } = navigator as { gpu?: { requestAdapter(): Promise<unknown> } };
  if (!gpu) return "this browser has no WebGPU";
  try {
    return (await gpu.requestAdapter()) ? null : "no WebGPU adapter in this browser";
  } catch (thrown) {
    return `this browser refused a WebGPU adapter (${gravisightErrorFrom(thrown).message})`;
  }
}
