/** The interface of the wasm builds, by hand: the builds may be absent when this package is compiled. */
import type { ClipAdded, Court, Forecast, LabelProposal, CalibrationResult, TuneScore, TuneStep } from "./types.js";
import type { RawFit } from "./protocol.js";

/** Options of one localisation, as the core takes them. */
export interface RawOptions {
  /** Also return the heatmap and the depth map. */
  maps: boolean;
  /** The true position in the world, in metres; only to score the answer. */
  truth?: [number, number, number];
}

/** The two maps the network draws. They are row-major and cover the whole picture. */
export interface RawMaps {
  /** Cells in a row. */
  width: number;
  /** Rows. */
  height: number;
  /** Probability that the ball is in the cell; sums to 1. */
  heatmap: Float32Array;
  /** Distance along the camera's axis, in metres. */
  depth: Float32Array;
}

/** How the depth depends on each pixel. */
export interface RawSaliency {
  width: number;
  height: number;
  values: Float32Array;
  depth: number;
}

/** One ball, as the core returns it. */
export interface RawLocalisation {
  /** In pixels of the picture that was given; an integer is a pixel's centre. */
  image: [number, number];
  /** Along the camera's axis (camera z), in metres. */
  depth: number;
  /** In the camera's frame (x right, y down, z forward), in metres. */
  camera: [number, number, number];
  /** In the world's frame (z up), in metres. */
  world: [number, number, number];
  /** From 0 to 1. */
  confidence: number;
  /** What a user should know, in words. */
  notes: string[];
  /** Distance to `truth` in metres, where it was given. */
  dtg?: number;
  /** Where they were asked for. */
  maps?: RawMaps;
}

/** The opaque object of a wasm build. */
export interface RawLocaliser {
  localise(picture: Uint8Array, cameraJson: string, options: RawOptions): Promise<RawLocalisation>;
  localiseRgba(rgba: Uint8Array, width: number, height: number, cameraJson: string, options: RawOptions): Promise<RawLocalisation>;
  saliency(picture: Uint8Array): RawSaliency;
  saliencyRgba(rgba: Uint8Array, width: number, height: number): RawSaliency;
  readonly deviceName: string;
  free(): void;
}

/** What pictures are given to, one after the other. */
export interface Collector {
  addPicture(rgba: Uint8Array, width: number, height: number): void;
  addFile(file: Uint8Array): void;
}

export interface RawFineTuner extends Collector {
  /** Forgets those of a clip that will not come. */
  dropPictures(): void;
  addClip(clipJson: string, heldOut: boolean): ClipAdded;
  step(): Promise<TuneStep | undefined>;
  evaluate(): Promise<TuneScore>;
  localiser(): RawLocaliser;
  export(): Promise<{ card: string; weights: Uint8Array }>;
  readonly deviceName: string;
  free(): void;
}

export interface RawSimulator {
  readonly camera: unknown;
  readonly scene: unknown;
  path(start: Float64Array, times: Float64Array): Float64Array;
  picture(centre: Float64Array): Uint8Array;
  clip(seed: number, number: number): unknown;
  free(): void;
}

export interface RawLabeller extends Collector {
  propose(radiiPx?: Float64Array): (LabelProposal | null)[];
  free(): void;
}

/** The module that wasm-pack writes (`--target web`). */
export interface RawModule {
  default(options: { module_or_path: BufferSource }): Promise<{ memory: WebAssembly.Memory }>;
  /** What the core said when it trapped; empty if it did not. */
  lastPanic(): string;
  Localiser: {
    create(cardJson: string, weights: Uint8Array, device: "cpu" | "webgpu"): Promise<RawLocaliser>;
  };
  FineTuner: {
    create(cardJson: string, weights: Uint8Array, optionsJson: string, device: "cpu" | "webgpu"): Promise<RawFineTuner>;
  };
  Simulator: new (environment: number | undefined, camera: number) => RawSimulator;
  Labeller: new (cameraJson: string) => RawLabeller;
  fitTrack(frames: string, camera: string, scene: string, noisePx: number | undefined, estimate: string[]): RawFit;
  forecast(scene: string, start: Float64Array, times: Float64Array): Forecast;
  calibrate(points: string, estimate: string[]): CalibrationResult;
  courts(): string[];
  court(name: string): Court;
  project(camera: string, points: Float64Array): Float64Array;
}
