/** What the engine can be asked for: the request and the answer of each call, wherever it runs. */
import type * as Core from "../wasm/cpu/gravisight.js";
import type { Device, DeviceChoice, Model, Progress } from "./types.js";

/** A picture on its way to the engine. */
export type PictureMessage =
  | { kind: "encoded"; bytes: Uint8Array }
  | { kind: "rgba"; rgba: Uint8Array; width: number; height: number }
  | { kind: "bitmap"; bitmap: ImageBitmap };

/** Where the builds and the weights come from. */
export interface Source {
  /** Absolute URL of the folder with the wasm builds; the package's own where it is missing. */
  wasm: string | undefined;
}

/** A position, how long the core took for it, in milliseconds, and on which device. */
type Timed = Core.Position & { milliseconds: number; device: Device };

export interface Calls {
  create: [Source & { model: string | Model | undefined; device: DeviceChoice; cache: boolean }, { device: Device; card: Core.Card }];
  localise: [{ picture: PictureMessage; camera: string; options: Core.Wanted }, Timed];
  saliency: [{ picture: PictureMessage }, Core.FloatMap];

  addFrame: [{ picture: PictureMessage; time: number; camera?: string }, null];
  trackVideo: [{ known: string }, Core.VideoTrack];

  open: [Source, null];
  fitTrack: [{ frames: string; camera: string; scene: string; noisePx: number | undefined; estimate: string[]; cameraSigma: string }, Core.Fit];
  forecast: [{ scene: string; start: number[]; times: number[] }, Core.Forecast];
  scenes: [Record<never, never>, string[]];
  scene: [{ name: string }, Core.Scene];
  calibrate: [{ points: string; estimate: string[]; picture?: PictureMessage | undefined }, Core.CalibrationResult];
  courts: [Record<never, never>, string[]];
  court: [{ name: string }, Core.Court];
  project: [{ camera: string; points: number[] }, Float64Array];
  proposeLabels: [{ camera: string; pictures: PictureMessage[]; radiiPx: [number, number] | undefined }, (Core.LabelProposal | null)[]];
  openScene: [{ environment: number | undefined; camera: number }, { id: number; camera: Core.Camera; scene: Core.Scene }];
  scenePath: [{ id: number; start: number[]; times: number[] }, Float64Array];
  scenePicture: [{ id: number; centre: number[] }, Uint8Array];
  sceneClip: [{ id: number; seed: number; number: number }, Core.SimulatedClip];
  closeScene: [{ id: number }, null];

  tuner: [Source & { model: string | Model | undefined; device: DeviceChoice; cache: boolean; options: string }, Device];
  addClip: [{ clip: string; pictures: PictureMessage[]; heldOut: boolean }, Core.Added];
  resumeTuner: [Source & { checkpoint: Uint8Array; device: DeviceChoice }, Device];
  tune: [{ count: number }, Core.Tuned | null];
  tuneProgress: [Record<never, never>, Core.TuneProgress];
  checkpoint: [Record<never, never>, Uint8Array];
  evaluate: [Record<never, never>, Core.TuneScore];
  tuned: [{ picture: PictureMessage; camera: string; options: Core.Wanted }, Timed];
  exportTuned: [Record<never, never>, Model];
}

export type CallName = keyof Calls;
export type Request<K extends CallName> = Calls[K][0];
export type Answer<K extends CallName> = Calls[K][1];

export type ToWorker = { [K in CallName]: { type: K; id: number; request: Request<K> } }[CallName];
export type FromWorker =
  | { type: "progress"; id: number; progress: Progress }
  | { type: "done"; id: number; answer: Answer<CallName> }
  | { type: "failed"; id: number; code: string; message: string };

/** How a call goes. */
export interface CallOptions {
  transfer?: Transferable[];
  signal?: AbortSignal | undefined;
  onProgress?: ((progress: Progress) => void) | undefined;
}

/** The way to an engine: in a Worker, or on this thread. */
export interface Transport {
  call<K extends CallName>(type: K, request: Request<K>, options?: CallOptions): Promise<Answer<K>>;
  /** Throws the reason of {@link close}. */
  throwIfClosed(): void;
  /** Ends the engine; every call that waits, and every later one, rejects with `reason`. */
  close(reason: unknown): void;
}
