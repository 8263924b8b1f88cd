import type { AdaptOptions as AdaptSettings, AdaptStep, AdapterInfo, Camera, CourtLine, FineTuneOptions as Settings, FloatMap, Model, Parameter, Picture, Position, Scene, Tuned, Wanted } from "../wasm/cpu/gravisight.js";

// What the core returns, and the files that it reads and writes, are declared by the core itself.
export type {
  AdapterInfo,
  AdapterLimits,
  AdaptFlights,
  AdaptProgress,
  AdaptScore,
  AdaptStep,
  AdaptedModel,
  Added as ClipAdded,
  AssociationConfig,
  AssumedCamera,
  Assumption,
  BackgroundConfig,
  Ball as SceneBall,
  BallAt,
  BlobsConfig,
  Bounds,
  Calibration,
  CalibrationMethod,
  Camera,
  CameraSigma,
  CameraToAssume,
  Candidate,
  Card,
  ClipKey,
  ClutterConfig,
  ConfidenceKind,
  Contact,
  ContactFinding,
  Court,
  CourtLine,
  CourtSearch,
  CourtVerdict,
  Cuboid,
  DetectionCalibration,
  Distortion,
  DrawablePicture,
  DrawnCircle,
  Estimate,
  EstimatorConfig,
  EvidenceConfig,
  Findings,
  FineTuneSupervision,
  FitSummary,
  FittedFrame,
  FittedImpact,
  Flight,
  FallConfig,
  FlightConfig,
  FlightFinding,
  FloatMap,
  Floor,
  Forecast,
  FoundCourt,
  FoundLine,
  GravityConfig,
  Hit,
  Impact,
  LensModel,
  LineSeen,
  Matrix3,
  Measured,
  Model,
  Normalisation,
  Observation,
  OtherCourt,
  OtherFrame,
  OtherTrack,
  OtherView,
  Parameter,
  Picture,
  Pixels,
  Plan,
  Point2,
  Point3,
  PointSigma,
  Position,
  QueriesConfig,
  RadiiConfig,
  Reason,
  Region,
  RegistrationConfig,
  RepeatsConfig,
  Rotation,
  Scene,
  SimulatedClip,
  SimulatedFrame,
  Size,
  SlowConfig,
  Spot,
  Spring,
  Statistic,
  Surface,
  ToldFit as Fit,
  ToldVideo as TrackedVideo,
  TrackedFrame,
  TrackerConfig,
  TrackletsConfig,
  Tuned as TuneStep,
  TuneProgress,
  TuneScore,
  Vector2,
  Vector3,
  Wall,
  WeightsConfig,
  WrongClick,
} from "../wasm/cpu/gravisight.js";
import type { Seed } from "./video-tracker.js";

/** Where the network can run. */
export type DeviceKind = "cpu" | "webgpu";
/** `auto` takes the faster one: where there is a WebGPU adapter it measures both once, and keeps the answer. */
export type DeviceChoice = DeviceKind | "auto";

/** The device that was taken. */
export interface Device {
  /** Where it computes. */
  kind: DeviceKind;
  /** For people, such as `CPU (relaxed SIMD, one thread)`. */
  name: string;
  /** Why it was taken, in words. */
  reason: string;
  /** Of WebGPU, as far as the browser tells. */
  adapter?: AdapterInfo;
}

/** How far loading is, or a fit. Stages may interleave: the wasm and the weights are fetched side by side. */
export interface Progress {
  /** What is waited for: the core, the model, a first picture, the comparison of devices, or a fit. */
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
  /** URL of the folder that holds `cpu/`, `cpu-relaxed/`, `cpu-threads/` and `webgpu/`; default: this package's `wasm/`. */
  wasm?: string | URL;
  /**
   * Threads that the CPU works on: a number, or `"auto"` for as many as the computer has, at most 8. In Node.js, and on pages that are
   * cross-origin isolated (served with `Cross-Origin-Opener-Policy: same-origin` and `Cross-Origin-Embedder-Policy: require-corp`); elsewhere,
   * where the browser lacks relaxed SIMD, and with `worker: false`, it is one, and {@link Device.name} says so. What is created first in a
   * Worker decides for all in it. Default: 1.
   */
  threads?: number | "auto";
  /**
   * Default: a Worker of its own; in Node.js only with `threads`. `false`: on the calling thread, such as inside a Worker of yours. Or a Worker
   * of yours that imports `gravisight/worker`: it may serve several objects, each with a model of its own, and is yours to end.
   */
  worker?: boolean | Worker;
  /** Stops the loading; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
  /** Hears how far the loading is. */
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
  /** The ball in this picture, instead of the localiser's. Without either the scene's. */
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
  /** Width of the picture, pixels. */
  width: number;
  /** Height of the picture, pixels. */
  height: number;
  /** The intrinsic matrix, 3 rows of 3, where it is known. */
  intrinsic?: number[][];
  /** The lens, where it is known. */
  distortion?: Camera["distortion"];
  /** Where each point was clicked, pixels. */
  image: [number, number][];
  /** Where each is in the world, metres; or `court` and `names`. */
  world?: Vector[];
  /** Name of a court ({@link Toolbox.courts}). */
  court?: string;
  /** Of each point its name on that court ({@link Toolbox.court}). */
  names?: string[];
  /** What is painted; without it, what is known of the court. */
  lines?: CourtLine[];
  /** 1-σ of the points, pixels, if a camera that was found has placed them ({@link FoundCourt.sigmaPx}); missing if they were clicked. */
  sigma_px?: number;
}

/** What a calibration can estimate besides the pose (and the focal length, where no intrinsic matrix is given). */
export type CalibrationUnknown = "focal" | "principal-point" | "distortion" | "full-distortion";

/** Options of {@link Adapter.create}. The model must read the ball's size and have a verifier and a motion network, as `any` does. */
export interface AdaptOptions extends ModelOptions, Partial<AdaptSettings> {}

/** Options of {@link Adapter.begin}. */
export interface AdaptBeginOptions {
  /** Ball positions that a person marked. Without a scene, the flight around each one becomes training data at any ball probability. */
  seeds?: Seed[];
  /** The camera that filmed the video; it is fixed. With `ball`, radii come from the distances that physics finds, where these are more accurate. */
  camera?: Camera;
  /** The ball in the video; needs `camera`. */
  ball?: Ball;
  /** Discards the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link Adapter.step}. */
export interface AdaptStepOptions {
  /** An abort takes effect after the current step. */
  signal?: AbortSignal;
  /** Called after each step. */
  onStep?: (step: AdaptStep) => void;
}

/** Options of {@link FineTuner.create}. */
export interface FineTuneOptions extends ModelOptions, Partial<Settings> {}

/** Options of {@link FineTuner.resume}. */
export interface FineTuneResumeOptions extends CoreOptions {
  /** Default: `cpu`. The run need not go on where it began. */
  device?: DeviceChoice;
  /** Keep in the browser what `auto` measured, and take it from there. Default: true. */
  cache?: boolean;
}

/** Options of {@link FineTuner.addClip}. */
export interface AddClipOptions {
  /** To score with, not to learn from. Default: false. */
  heldOut?: boolean;
  /** Drops the clip; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link FineTuner.step}. */
export interface StepOptions {
  /** Takes effect after the step that is under way. */
  signal?: AbortSignal;
  /** Hears of each step. */
  onStep?: (step: Tuned) => void;
}

/** Options of {@link Toolbox.calibrate}. */
export interface CalibrateOptions {
  /** What to estimate besides the pose. */
  estimate?: CalibrationUnknown[];
  /** A picture of the court, whose painted lines are used. */
  picture?: Picture;
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link Toolbox.findCourt}. */
export interface FindCourtOptions {
  /** What to estimate besides the pose and the focal length. */
  estimate?: CalibrationUnknown[];
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link Toolbox.ballAt}. */
export interface BallAtOptions {
  /** `oneSigma` of the calibration that made the camera, or of {@link Toolbox.assumedCamera}: its uncertainty enters σ. */
  cameraSigma?: Camera[];
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link Toolbox.fitTrack}. */
export interface FitTrackOptions {
  /** The camera that saw the ball; it stands still. */
  camera: Camera;
  /** Gravity, the ball, and what it can touch. */
  scene: Scene;
  /** Standard deviation of the 2D positions, pixels; found from them where missing. */
  noisePx?: number;
  /** What to estimate besides the trajectory. */
  estimate?: Parameter[];
  /** `oneSigma` of the calibration that made the camera: its uncertainty enters σ. */
  cameraSigma?: Camera[];
  /** Whether the camera is assumed ({@link Toolbox.assumedCamera}): its uncertainty then enters σ and rejects no flight. Default: false. */
  cameraAssumed?: boolean;
  /** Drops the result; the promise rejects with the signal's reason. */
  signal?: AbortSignal;
}

/** Options of {@link Toolbox.simulator}. */
export interface SimulatorOptions {
  /** 1 to 3, or the spring. */
  environment: 1 | 2 | 3 | "spring";
  /** 1 to 9. Default: 1. */
  camera?: number;
}

/** A clip to learn from: consecutive frames of a camera that does not move. */
export interface TrainingClip {
  /** Its name. */
  id: string;
  /** Frames a second. */
  fps: number;
  /** The camera that took it. */
  camera: Camera;
  /** Gravity, the ball, and what it can touch. */
  scene: Scene;
  /** All frames, in order. */
  frames: TrainingFrame[];
}

/** A frame of a {@link TrainingClip}. */
export interface TrainingFrame {
  /** Encoded, or as pixels. */
  picture: Picture;
  /** Seconds; default: the frame's number over `fps`. */
  t?: number;
  /** The ball's centre, pixels; null where it is not seen. */
  image: [number, number] | null;
  /** 3D truth, metres: only to score with. */
  world?: Vector;
}
