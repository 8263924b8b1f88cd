import type { RawLocalisation } from "./raw.js";

/** Where the network can run. */
export type DeviceKind = "cpu" | "webgpu";
/** `auto` takes WebGPU where the browser has an adapter, and the CPU otherwise. */
export type DeviceChoice = DeviceKind | "auto";

/** The device that was taken. */
export interface Device {
  kind: DeviceKind;
  /** For people, such as `CPU (relaxed SIMD, one thread)`. */
  name: string;
  /** Why it was taken, in words. */
  reason: string;
}

/** How far loading is. Stages may interleave: the wasm and the weights are fetched side by side. */
export interface Progress {
  stage: "wasm" | "weights" | "warming up";
  /** Bytes so far. */
  loaded: number;
  /** Bytes in all, or null where the server does not say. */
  total: number | null;
}

/** A calibrated camera: the content of a `camera.json`. Matrices are arrays of rows. */
export interface Camera {
  /** Of the pictures that `intrinsic` speaks of, in pixels. */
  width: number;
  height: number;
  /** 3×3, in pixels. */
  intrinsic: number[][];
  /** 4×4, rigid, in metres. */
  camera_from_world: number[][];
  /** Brown–Conrady, in OpenCV's order. */
  distortion?: { k1: number; k2: number; p1: number; p2: number; k3: number };
}

/**
 * A picture. Encoded bytes (PNG, JPEG or WebP in a `Blob`, `ArrayBuffer` or `Uint8Array`) are decoded by the core
 * itself, so that every browser and the command line agree; anything else is drawn to pixels first.
 */
export type Picture = Blob | ArrayBuffer | Uint8Array | ImageData | DrawablePicture;
/** What a browser can draw. */
export type DrawablePicture =
  | ImageBitmap
  | HTMLCanvasElement
  | HTMLVideoElement
  | HTMLImageElement
  | OffscreenCanvas
  | VideoFrame;

/** Options of {@link Localiser.create}. */
export interface CreateOptions {
  /** URL of the model's JSON card; the weights are the `.safetensors` file beside it. */
  model: string | URL;
  /** Default: `cpu`. */
  device?: DeviceChoice;
  /** Stops the loading; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
  onProgress?: (progress: Progress) => void;
}

/** Options of {@link Localiser.localise}. */
export interface LocaliseOptions {
  /** The camera that took the picture. */
  camera: Camera;
  /** Also return the heatmap and the depth map. Default: false. */
  maps?: boolean;
  /** The true position in the world, in metres: the result then carries `dtg`, the distance to it. */
  truth?: [number, number, number];
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Where the ball is. */
export interface Localisation extends RawLocalisation {
  /** Time the core took, measured in the Worker. */
  milliseconds: number;
  /** The device that it ran on. */
  device: Device;
}

/** Where the ball is in a frame of a video. */
export interface FrameLocalisation extends Localisation {
  /** The timestamp that was given with the frame. */
  timestampMs: number;
}
