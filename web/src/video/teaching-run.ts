/** A run of teaching as this browser keeps it: what the core needs to go on. The video is given again. */
import type { Ball, Camera, DeviceChoice, TrackedVideo } from "gravisight";
import { del, get, set } from "idb-keyval";
import { isSameVideo, type VideoIdentity } from "./session";
import type { Correction } from "./tracking";

export interface KeptTeaching {
  video: VideoIdentity;
  /** Of the new model. */
  name: string;
  /** The track that it learns from. */
  tracked: Pick<TrackedVideo, "explained" | "frames">;
  seeds: Correction[];
  /** Of a track in metres. */
  camera?: Camera;
  ball?: Ball;
  device: DeviceChoice;
  step: number;
  steps: number;
  checkpoint: Uint8Array;
}

const RUN = "teaching run";

export async function keptTeaching(): Promise<KeptTeaching | undefined> {
  return get<KeptTeaching>(RUN).catch(() => undefined);
}

/** Keeps a run in place of the one before. Throws where the browser has no room. */
export async function keepTeaching(run: KeptTeaching): Promise<void> {
  await set(RUN, run);
}

/** Forgets the run of a video; that of another stays. */
export async function forgetTeaching(video: VideoIdentity): Promise<void> {
  const kept = await keptTeaching();
  if (kept && isSameVideo(video, kept.video)) await del(RUN).catch(() => undefined);
}
