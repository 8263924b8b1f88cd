/** The messages between the page and the Worker. */
import type { RawLocalisation, RawOptions } from "./raw.js";
import type { Device, DeviceChoice, Progress } from "./types.js";

/** A picture on its way to the Worker. */
export type PictureMessage =
  | { kind: "encoded"; bytes: Uint8Array }
  | { kind: "rgba"; rgba: Uint8Array; width: number; height: number }
  | { kind: "bitmap"; bitmap: ImageBitmap };

/** What the page can ask for, by name. */
export interface Requests {
  create: { model: string; device: DeviceChoice };
  localise: { picture: PictureMessage; camera: string; options: RawOptions };
}

/** What the Worker answers, by the name of the request. */
export interface Answers {
  create: Device;
  localise: RawLocalisation & { milliseconds: number };
}

export type RequestName = keyof Requests;
export type ToWorker = { [K in RequestName]: { type: K; id: number } & Requests[K] }[RequestName];
export type FromWorker =
  | { type: "progress"; id: number; progress: Progress }
  | { type: "done"; id: number; answer: Answers[RequestName] }
  | { type: "failed"; id: number; code: string; message: string };
