/** The interface of the wasm builds, by hand: the builds may be absent when this package is compiled. */

/** Options of one localisation, as the core takes them. */
export interface RawOptions {
  /** Also return the heatmap and the depth map. */
  maps: boolean;
  /** The true position in the world, in metres; only to score the answer. */
  truth?: [number, number, number];
}

/** The two maps the network draws. They are row-major and cover the whole picture. */
export interface Maps {
  /** Cells in a row. */
  width: number;
  /** Rows. */
  height: number;
  /** Probability that the ball is in the cell; sums to 1. */
  heatmap: Float32Array;
  /** Distance along the camera's axis, in metres. */
  depth: Float32Array;
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
  maps?: Maps;
}

/** The opaque object of a wasm build. */
export interface RawLocaliser {
  localise(picture: Uint8Array, cameraJson: string, options: RawOptions): Promise<RawLocalisation>;
  localiseRgba(
    rgba: Uint8Array,
    width: number,
    height: number,
    cameraJson: string,
    options: RawOptions,
  ): Promise<RawLocalisation>;
  readonly deviceName: string;
  free(): void;
}

/** The module that wasm-pack writes (`--target web`). */
export interface RawModule {
  default(options: { module_or_path: BufferSource }): Promise<unknown>;
  /** What the core said when it trapped; empty if it did not. */
  lastPanic(): string;
  Localiser: {
    create(cardJson: string, weights: Uint8Array, device: "cpu" | "webgpu"): Promise<RawLocaliser>;
  };
}
