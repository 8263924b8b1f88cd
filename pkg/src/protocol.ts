/** The engine's calls: the request and the answer of each, wherever it runs. */
import type * as Core from "../wasm/cpu/gravisight.js";
import type { Device, DeviceChoice, Model, Progress } from "./types.js";

/** A picture on its way to the engine, whose own it is. */
export type PictureMessage = Exclude<Core.Picture, HTMLElement | VideoFrame | OffscreenCanvas>;

/** Where the builds and the weights come from. */
export interface Source {
  /** Absolute URL of the folder with the wasm builds; the package's own where it is missing. */
  wasm: string | undefined;
  /** Threads of the CPU's build. */
  threads: number | "auto";
}

/** A position, and on which device it was found. */
type Found = Core.Position & { device: Device };

export interface Calls {
  create: [Source & { model: string | Model | undefined; device: DeviceChoice; cache: boolean }, { device: Device; card: Core.Card }];
  localise: [{ picture: PictureMessage; camera: string; options: Core.Wanted }, Found];
  saliency: [{ picture: PictureMessage }, Core.FloatMap];

  /** Answers with the memory of the frame's pixels, where it was sent as such: the next frame's may be written there. */
  addFrame: [{ picture: PictureMessage; time: number; camera: string | undefined; config: string | undefined; court: string | undefined; sport: string | undefined }, Uint8Array<ArrayBuffer> | null];
  trackVideo: [{ known: string; config: string | undefined }, Core.ToldVideo];

  open: [Source, null];
  fitTrack: [{ frames: string; camera: string; scene: string; noisePx: number | undefined; estimate: string[]; cameraSigma: string; cameraAssumed: boolean }, Core.ToldFit];
  forecast: [{ scene: string; start: number[]; times: number[] }, Core.Forecast];
  scenes: [Record<never, never>, string[]];
  scene: [{ name: string }, Core.Scene];
  sceneWithBall: [{ scene: string; radius: number }, Core.Scene];
  calibrate: [{ points: string; estimate: string[]; picture: PictureMessage | undefined }, Core.Calibration];
  findCourt: [{ picture: PictureMessage; court: string; estimate: string[] }, Core.CourtSearch];
  courts: [Record<never, never>, string[]];
  court: [{ name: string }, Core.Court];
  project: [{ camera: string; points: number[] }, Float64Array];
  ballAt: [{ camera: string; circle: Core.DrawnCircle; radius: number; cameraSigma: string }, Core.BallAt];
  assumedCamera: [{ known: Core.CameraToAssume }, Core.AssumedCamera];
  openScene: [{ environment: number | undefined; camera: number }, { id: number; camera: Core.Camera; scene: Core.Scene }];
  scenePath: [{ id: number; start: number[]; times: number[] }, Float64Array];
  scenePicture: [{ id: number; centre: number[] }, Uint8Array];
  sceneClip: [{ id: number; seed: number; number: number }, Core.SimulatedClip];
  closeScene: [{ id: number }, null];

  tuner: [Source & { model: string | Model | undefined; device: DeviceChoice; cache: boolean; options: string }, Device];
  addClip: [{ clip: string; pictures: PictureMessage[]; heldOut: boolean }, Core.Added];
  resumeTuner: [Source & { checkpoint: Uint8Array; device: DeviceChoice; cache: boolean }, Device];
  tune: [{ count: number }, Core.Tuned | null];
  tuneProgress: [Record<never, never>, Core.TuneProgress];
  checkpoint: [Record<never, never>, Uint8Array];
  evaluate: [Record<never, never>, Core.TuneScore];
  tuned: [{ picture: PictureMessage; camera: string; options: Core.Wanted }, Found];
  exportTuned: [Record<never, never>, Model];

  adapter: [Source & { model: string | Model | undefined; device: DeviceChoice; cache: boolean; options: string }, Device];
  resumeAdapter: [Source & { checkpoint: Uint8Array; device: DeviceChoice; cache: boolean }, Device];
  adaptBegin: [{ tracked: string; seeds: string; camera: string | undefined; radius: number | undefined }, Core.AdaptFlights];
  adaptAdd: [{ picture: PictureMessage; time: number }, null];
  adaptEnd: [Record<never, never>, null];
  adaptStep: [Record<never, never>, Core.AdaptStep | null];
  adaptProgress: [Record<never, never>, Core.AdaptProgress];
  adaptCheckpoint: [Record<never, never>, Uint8Array];
  adaptFinish: [{ name: string }, Core.AdaptedModel];
}

export type CallName = keyof Calls;
export type Request<K extends CallName> = Calls[K][0];
export type Answer<K extends CallName> = Calls[K][1];

/**
 * Messages name the object (a `Localiser`, a `Toolbox`, …) that they are of: one Worker may serve several, and each page's end hears
 * the answers to all. `close` frees what the Worker holds for one of them.
 */
export type ToWorker = { object: string } & ({ [K in CallName]: { type: K; id: number; request: Request<K> } }[CallName] | { type: "close" } | { type: "hello" });
export type FromWorker = { object: string } & (
  | { type: "progress"; id: number; progress: Progress }
  | { type: "done"; id: number; answer: Answer<CallName> }
  | { type: "failed"; id: number; code: string; message: string }
  /** First of all, and to `hello`: the Worker is there, and its threads' failures are reported on this `BroadcastChannel`. */
  | { type: "here"; threads: string }
);

/** How a call goes. */
export interface CallOptions {
  transfer?: Transferable[];
  signal?: AbortSignal | undefined;
  onProgress?: ((progress: Progress) => void) | undefined;
}

/** One object's way to its engine: in a Worker, or on this thread. */
export interface Transport {
  call<K extends CallName>(type: K, request: Request<K>, options?: CallOptions): Promise<Answer<K>>;
  /** Throws the reason of {@link close}. */
  throwIfClosed(): void;
  /** Frees the object's memory; every call that waits, and every later one, rejects with `reason`. */
  close(reason: unknown): void;
}
