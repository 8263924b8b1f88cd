import type { Adapter, Camera, CourtLine, FineTuneOptions as Settings, FloatMap, Model, Picture, Position, Scene, Wanted } from "../wasm/cpu/gravisight.js";

// What the core returns, and the files that it reads and writes, are declared by the core itself.
export type {
  Adapter,
  AdapterLimits,
  Added as ClipAdded,
  Calibration,
  CalibrationMethod,
  Camera,
  CameraSigma,
  Candidate,
  Card,
  ClipKey,
  Court,
  CourtLine,
  DrawablePicture,
  ContactFinding,
  Estimate,
  EstimatorConfig,
  FineTuneSupervision,
  Findings,
  FittedFrame,
  FittedImpact,
  Flight,
  FlightFinding,
  FloatMap,
  Forecast,
  Hit,
  Impact,
  LineSeen,
  Model,
  Measured,
  Observation,
  OtherView,
  Parameter,
  Picture,
  Pixels,
  Plan,
  PointSigma,
  Position,
  Reason,
  Region,
  Scene,
  SimulatedClip,
  Spot,
  Statistic,
  Surface,
  TrackedFrame,
  TrackerConfig,
  ToldFit as Fit,
  ToldVideo as TrackedVideo,
  Tuned as TuneStep,
  TuneProgress,
  TuneScore,
  WrongClick,
} from "../wasm/cpu/gravisight.js";

/** Where the network can run. */
export type DeviceKind = "cpu" | "webgpu";
/** `auto` takes the faster one: where there is a WebGPU adapter it measures both once, and keeps the answer. */
export type DeviceChoice = DeviceKind | "auto";

/** The device that was taken. */
export interface Device {
  kind: DeviceKind;
  /** For people, such as `CPU (relaxed SIMD, one thread)`. */
  name: string;
  /** Why it was taken, in words. */
  reason: string;
  /** Of WebGPU, as far as the browser tells. */
  adapter?: Adapter;
}

/** How far loading is, or a fit. Stages may interleave: the wasm and the weights are fetched side by side. */
export interface Progress {
  stage: "wasm" | "weights" | "warming up" | "measuring" | "fit";
  /** Bytes so far; of measuring the devices, pictures; of a fit, the parts of the video that are done. */
  loaded: number;
  /** Bytes (pictures, parts) in all, or null where the server does not say. */
  total: number | null;
}

/** A point or a vector: metres, or metres a second. */
export type Vector = [number, number, number];

/** Where the core comes from and runs. */
export interface CoreOptions {
  /** URL of the folder that holds `cpu/`, `cpu-relaxed/` and `webgpu/`; default: this package's `wasm/`. */
  wasm?: string | URL;
  /**
   * Default: a Worker of its own. `false`: on the calling thread, as for Node.js or inside a Worker of yours. Or a Worker
   * of yours that imports `gravisight/worker`: it may serve several objects, each with a model of its own, and is yours to end.
   */
  worker?: boolean | Worker;
  /** Stops the loading; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
  onProgress?: (progress: Progress) => void;
}

/** Where a model comes from and runs. */
export interface ModelOptions extends CoreOptions {
  /**
   * URL of the model's JSON card, the weights being the `.safetensors` file beside it; or a model in memory. Default: the
   * package's own, `any`, which reads the apparent size of any ball and needs its radius.
   */
  model?: string | URL | Model;
  /** Default: `cpu`. */
  device?: DeviceChoice;
  /**
   * Keep the weights in the browser's Cache API, by their sha256, and what `auto` measured, and take them from there. Default:
   * true.
   */
  cache?: boolean;
}

/** The ball that is looked for. */
export interface Ball {
  /** Metres; a tennis ball's is 0.0335. An error of 1 % in it is one of 1 % in the depth. */
  radius: number;
}

/** Options of {@link Localiser.create}. */
export interface CreateOptions extends ModelOptions {
  /** The ball; see {@link Localiser.setBall}. A model that reads sizes needs it. */
  ball?: Ball;
  /** The camera that takes the pictures; see {@link Localiser.setCamera}. */
  camera?: Camera;
}

/** Options of {@link Localiser.localise}. */
export interface LocaliseOptions extends Omit<Wanted, "ballRadius"> {
  /** The ball in this picture, instead of the localiser's. */
  ball?: Ball;
  /** The camera that took this picture, instead of the localiser's. */
  camera?: Camera;
  /** Also return how the depth depends on each pixel: a backward pass on the CPU, many times slower. */
  saliency?: boolean;
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Where the ball is. */
export interface Localisation extends Position {
  /** Metres of depth by full brightness of the pixel. Where asked for. */
  saliency?: FloatMap;
  /** The device that it ran on. */
  device: Device;
}

/** Where the ball is in a frame of a video. */
export interface FrameLocalisation extends Localisation {
  /** The timestamp that was given with the frame. */
  timestampMs: number;
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
  /** What is painted; without it, what is known of the court. */
  lines?: CourtLine[];
}

/** What a calibration can estimate besides the pose (and the focal length, where no intrinsic matrix is given). */
export type CalibrationUnknown = "focal" | "principal-point" | "distortion" | "full-distortion";

/** Options of {@link FineTuner.create}. */
export interface FineTuneOptions extends ModelOptions, Partial<Settings> {}

/** Options of {@link FineTuner.resume}. */
export interface FineTuneResumeOptions extends CoreOptions {
  /** Default: `cpu`. The run need not go on where it began. */
  device?: DeviceChoice;
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
