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

/** RGBA pixels, row-major: an `ImageData`, or what looks like one. */
export interface Pixels {
  data: Uint8ClampedArray | Uint8Array;
  width: number;
  height: number;
}

/**
 * A picture. Encoded bytes (PNG, JPEG or WebP in a `Blob`, `ArrayBuffer` or `Uint8Array`) are decoded by the core
 * itself, so that every browser and the command line agree; anything else is drawn to pixels first.
 */
export type Picture = Blob | ArrayBuffer | Uint8Array | Pixels | DrawablePicture;
/** What a browser can draw. */
export type DrawablePicture =
  | ImageBitmap
  | HTMLCanvasElement
  | HTMLVideoElement
  | HTMLImageElement
  | OffscreenCanvas
  | VideoFrame;

/** A point or a vector: metres, or metres a second. */
export type Vector = [number, number, number];

/** Where the core comes from and runs. */
export interface CoreOptions {
  /** URL of the folder that holds `cpu/`, `cpu-relaxed/` and `webgpu/`; default: this package's `wasm/`. */
  wasm?: string | URL;
  /**
   * Default: a Worker of its own. `false`: on the calling thread, as for Node.js or inside a Worker of yours. Or a Worker
   * of yours that imports `gravisight/worker`; `dispose` ends it.
   */
  worker?: boolean | Worker;
  /** Stops the loading; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
  onProgress?: (progress: Progress) => void;
}

/** A model in memory, as {@link FineTuner.export} returns it. */
export interface Model {
  /** The JSON card's text. */
  card: string;
  /** The content of the `.safetensors` file. */
  weights: Uint8Array;
}

/** Where a model comes from and runs. */
export interface ModelOptions extends CoreOptions {
  /** URL of the model's JSON card, the weights being the `.safetensors` file beside it; or a model in memory. */
  model: string | URL | Model;
  /** Default: `cpu`. */
  device?: DeviceChoice;
  /** Keep the weights in the browser's Cache API, by their sha256, and take them from there. Default: true. */
  cache?: boolean;
}

/** Options of {@link Localiser.create}. */
export interface CreateOptions extends ModelOptions {
  /** The camera that takes the pictures; see {@link Localiser.setCamera}. */
  camera?: Camera;
}

/** Options of {@link Localiser.localise}. */
export interface LocaliseOptions {
  /** The camera that took this picture, instead of the localiser's. */
  camera?: Camera;
  /** Also return the heatmap. */
  heatmap?: boolean;
  /** Also return the depth map. */
  depthMap?: boolean;
  /** Also return how the depth depends on each pixel: a backward pass on the CPU, many times slower. */
  saliency?: boolean;
  /** The true position in the world, in metres: the result then carries `dtg`, the distance to it. */
  truth?: Vector;
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** A map over the whole picture, row-major. */
export interface FloatMap {
  /** Cells in a row. */
  width: number;
  /** Rows. */
  height: number;
  values: Float32Array;
}

/** Where the ball is. */
export interface Localisation {
  /** In pixels of the picture that was given; an integer is a pixel's centre. */
  image: [number, number];
  /** Along the camera's axis (camera z), in metres. */
  depth: number;
  /** In the camera's frame (x right, y down, z forward), in metres. */
  camera: Vector;
  /** In the world's frame (z up), in metres. */
  world: Vector;
  /** From 0 to 1. */
  confidence: number;
  /** What a user should know, in words. */
  notes: string[];
  /** Distance to `truth` in metres, where it was given. */
  dtg?: number;
  /** Probability that the ball is in the cell; sums to 1. Where asked for. */
  heatmap?: FloatMap;
  /** Distance along the camera's axis, in metres. Where asked for. */
  depthMap?: FloatMap;
  /** Metres of depth by full brightness of the pixel. Where asked for. */
  saliency?: FloatMap;
  /** Time the core took for the position. */
  milliseconds: number;
  /** The device that it ran on. */
  device: Device;
}

/** Where the ball is in a frame of a video. */
export interface FrameLocalisation extends Localisation {
  /** The timestamp that was given with the frame. */
  timestampMs: number;
}

/** A place and its ball: the content of a `scene.json`. SI units, z up. */
export interface Scene {
  gravity: Vector;
  ball: {
    radius: number;
    mass?: number;
    drag_coefficient?: number;
    lift_coefficient?: number;
    air_density?: number;
    spin?: Vector;
    spin_decay?: number;
    inertia_factor?: number;
  };
  contact?:
    | { model: "penalty"; c: number; beta: number; beta_box: number }
    | { model: "spring"; stiffness: number }
    | { model: "bounce"; restitution: number; friction: number };
  floor?: { height: number };
  walls?: { point: Vector; normal: Vector }[];
  boxes?: { position: Vector; half_size: Vector; yaw?: number }[];
  spring?: { stiffness: number; anchor: Vector };
}

/** What a fit can estimate besides the trajectory. */
export type Parameter = "restitution" | "drag" | "spin";

/** One moment of a trajectory. */
export interface TrajectoryPoint {
  timestampMs: number;
  /** Metres. */
  world: Vector;
  /** Metres a second. */
  velocity: Vector;
  /** Metres a second. */
  speed: number;
  /** 1-σ of the position, metres. */
  sigma: number;
  /** The trajectory's image less what was seen, pixels; null where nothing was seen. */
  residualPx: [number, number] | null;
  /** Whether what was seen there does not belong to the trajectory. */
  outlier: boolean;
}

/** Where the ball touched something. */
export interface Bounce {
  timestampMs: number;
  /** Of the ball's centre, metres. */
  world: Vector;
  /** What it touched, as the scene names it: `floor`, `boxes[0]`, … */
  surface: string;
  /** Approach, metres a second. */
  speed: number;
}

/** The trajectory that physics allows and what was seen explains. */
export interface Trajectory {
  points: TrajectoryPoint[];
  bounces: Bounce[];
  /** Root mean square of the residuals, pixels. */
  rmsPx: number;
  /** Standard deviation of what was seen, pixels: given, or found. */
  noisePx: number;
  /** If not, a force is unknown, or scene or camera are wrong: do not trust it. */
  explained: boolean;
  /** What was to be estimated. */
  estimates: Partial<Record<Parameter, { value: number; sigma: number }>>;
}

/** A ball's states at the times asked for: x, y, z (m) and the velocity (m/s). */
export interface Forecast {
  states: [number, number, number, number, number, number][];
  impacts: { t: number; surface: string; world: Vector; speed: number }[];
  /** How it ended, in words. */
  status: string;
}

/** Labelled points: the content of a `points.json`. */
export interface CalibrationPoints {
  /** Of the picture, pixels. */
  width: number;
  height: number;
  /** Where it is known. */
  intrinsic?: number[][];
  distortion?: Camera["distortion"];
  /** Where each point was clicked, pixels. */
  image: [number, number][];
  /** Where each is in the world, metres; or `court` and `names`. */
  world?: Vector[];
  court?: string;
  names?: string[];
}

/** What a calibration can estimate besides the pose (and the focal length, where no intrinsic matrix is given). */
export type CalibrationUnknown = "focal" | "principal-point" | "distortion" | "full-distortion";

/** A camera and how good it is. */
export interface CalibrationResult {
  camera: Camera;
  rms_px: number;
  noise_px: number;
  method: "dlt" | "homography";
  /** Of each point: where the camera puts it less where it was clicked. */
  residuals_px: [number, number][];
  /** Clicks that do not fit the others; they had no part in the camera. */
  outliers: { index: number; name: string | null; residual_px: [number, number] }[];
  sigma: { rotation: Vector; centre: Vector; focal_px: number };
  /** 1-σ of a position in the picture's middle, as far as the camera is to blame. */
  point_sigma: { image: [number, number]; depth: number; world: Vector };
}

/** A court's named points, metres. */
export interface Court {
  about: string;
  points: Record<string, Vector>;
}

/** A proposed 2D label. */
export interface LabelProposal {
  image: [number, number];
  radiusPx: number;
  /** Share of such labels that are within a pixel of the truth. */
  confidence: number;
  /** Whether a person should look at it. */
  doubtful: boolean;
}

/** Options of {@link FineTuner.create}. */
export interface FineTuneOptions extends ModelOptions {
  /** Optimiser steps in all; the learning rate falls over them. Default: 200. */
  steps?: number;
  /** Crops a step. Default: 12. */
  batch?: number;
  /** Side of the crops, pixels of the network's input. Default: 128. */
  crop?: number;
  /** Default: 0.001. */
  learningRate?: number;
  /** Default: 1. */
  seed?: number;
}

/** A clip to learn from: consecutive frames of a camera that does not move. */
export interface TrainingClip {
  /** Its name. */
  id: string;
  fps: number;
  camera: Camera;
  scene: Scene;
  frames: {
    /** Encoded, or as pixels. */
    picture: Picture;
    /** Seconds; default: the frame's number over `fps`. */
    t?: number;
    /** The ball's centre, pixels; null where it is not seen. */
    image: [number, number] | null;
    /** 3D truth, metres: only to score with. */
    world?: Vector;
  }[];
}

/** What a clip gives. */
export interface ClipAdded {
  /** Frames that teach, or are scored. */
  frames: number;
  /** Why the clip teaches nothing. */
  leftOut?: string;
}

/** A step of fine-tuning. */
export interface TuneStep {
  step: number;
  steps: number;
  loss: number;
  heatmap: number;
  /** Robust error of the depths. */
  depth: number;
}

/** Mean and so on of a measure over `n` values; null where there are none. */
export interface Statistic {
  mean: number | null;
  std: number | null;
  median: number | null;
  n: number;
}

/** How good the weights are on the clips held out. */
export interface TuneScore {
  /** Median error of forecasts 15 frames away, pixels: 2D labels are enough. */
  forecast_px?: number;
  least_confidence: number;
  image_error_px: Statistic;
  /** Metres; without values where there is no 3D truth. */
  dtg: Statistic;
}
