/** What WebGPU adapter there is, and which device is faster: measured once for a model, an adapter and a version of this package. */
import type * as Core from "../wasm/cpu/gravisight.js";
import { cached, keep } from "./cache.js";
import { GravisightError, gravisightErrorFrom } from "./error.js";
import type { Device, DeviceKind, Progress } from "./types.js";
import { VERSION } from "./version.js";

/** What is used of WebGPU, which the DOM's types do not know in every version. */
interface GpuAdapter {
  info?: Partial<Core.AdapterInfo>;
  limits: Partial<Core.AdapterLimits>;
}
interface Gpu {
  requestAdapter(options: { powerPreference: "high-performance" }): Promise<GpuAdapter | null>;
}

/** How long a picture takes, ms, and when that was measured. */
interface Times extends Record<DeviceKind, number> {
  /** Such as `2026-11-25`. */
  day: string;
}

const PICTURES = 3;

/** The adapter of this thread, as Burn asks for it, or why there is none. */
export async function adapterHere(): Promise<{ adapter: GpuAdapter } | { missing: string }> {
  const gpu = (globalThis.navigator as { gpu?: Gpu } | undefined)?.gpu;
  if (!gpu) return { missing: "this browser has no WebGPU" };
  try {
    const adapter = await gpu.requestAdapter({ powerPreference: "high-performance" });
    return adapter ? { adapter } : { missing: "no WebGPU adapter in this browser" };
  } catch (thrown) {
    return { missing: `this browser refused a WebGPU adapter (${gravisightErrorFrom(thrown).message})` };
  }
}

/** A device that was chosen by name; `webgpu-no-adapter` where it is not there. */
export async function requestedDevice(kind: DeviceKind): Promise<Pick<Device, "kind" | "reason">> {
  const found = kind === "webgpu" ? await adapterHere() : {};
  if ("missing" in found) throw new GravisightError("webgpu-no-adapter", `WebGPU cannot be used: ${found.missing}.`);
  return { kind, reason: "as requested" };
}

/** The name under which times are kept. Browsers that keep an adapter's names to themselves tell adapters apart by their limits. */
export function timesKey(card: string, { info = {}, limits }: GpuAdapter): string {
  const { sha256 } = JSON.parse(card) as Partial<Core.Card>;
  const { maxBufferSize, maxStorageBufferBindingSize } = limits;
  const adapter = [info.vendor, info.architecture, info.device, info.description, maxBufferSize, maxStorageBufferBindingSize];
  return `times ${JSON.stringify([VERSION, sha256, adapter])}`;
}

export async function keptTimes(key: string): Promise<Times | null> {
  const kept = await cached(key);
  try {
    const times = kept && (JSON.parse(new TextDecoder().decode(kept)) as Times);
    return times && times.cpu > 0 && times.webgpu > 0 ? times : null;
  } catch {
    return null; // measured anew
  }
}

export function keepTimes(key: string, times: Times): Promise<void> {
  return keep(key, JSON.stringify(times));
}

/** The median of three pictures, ms. */
export async function measure(core: Core.Localiser, onPicture: () => void): Promise<number> {
  const times: number[] = [];
  while (times.length < PICTURES) {
    times.push(await core.measure());
    onPicture();
  }
  return times.sort((a, b) => a - b)[PICTURES >> 1] as number;
}

/** Hears of each picture that was measured, of two devices. */
export function countingTo(onProgress: (progress: Progress) => void): () => void {
  let loaded = 0;
  return () => onProgress({ stage: "measuring", loaded: ++loaded, total: 2 * PICTURES });
}

export function faster({ cpu, webgpu }: Times): DeviceKind {
  return webgpu < cpu ? "webgpu" : "cpu";
}

/** The reason that these times give for a device. */
export function reasonOf(times: Times, isKept: boolean): string {
  const [cpu, webgpu] = [times.cpu, times.webgpu].map((ms) => `${ms.toPrecision(3)} ms`);
  const comparison = faster(times) === "webgpu" ? `WebGPU is faster: ${webgpu} per picture, the CPU ${cpu}` : `the CPU is faster: ${cpu} per picture, WebGPU ${webgpu}`;
  return `auto: ${comparison}${isKept ? ` (measured on ${times.day})` : ""}`;
}
