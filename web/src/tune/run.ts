/** A run as this browser keeps it: what the core needs to go on, and what the page shows. The clips are kept by themselves. */
import type { DeviceChoice, FineTuneSupervision, TuneScore } from "gravisight";
import { del, get, set } from "idb-keyval";
import type { Look } from "./looks";

export interface Run {
  /** Whether it goes on by itself when the page is opened again. */
  state: "running" | "stopped" | "done";
  /** Name of the model that it started from. */
  model: string;
  supervision: FineTuneSupervision;
  device: DeviceChoice;
  steps: number;
  /** Ids of the clips, in the order in which they were given. */
  clips: { id: string; heldOut: boolean }[];
  /** What the model found in frames of the clip that is shown, before, and once the run is done. */
  before: Look[];
  now?: Look[];
  /** In how many of these frames the ball was found. */
  found?: Counts;
  /** In how many of all its labelled frames a tracker found it; of a model that takes balls of any size. */
  followed?: Counts;
  /** Score before the first step, and the last. */
  first: TuneScore;
  last: TuneScore;
  /** Step and value. */
  losses: [number, number][];
  scores: [number, number][];
  /** Time spent on steps, ms. */
  spent: number;
  checkpoint: Uint8Array;
}

interface Counts {
  before: number;
  now?: number;
  of: number;
}

const RUN = "tuning run";
const LOCK = "gravisight tuning";
/** A page that is reloaded may hold its lock for so long after, ms. */
const LEAVING = 3000;

export async function keptRun(): Promise<Run | undefined> {
  return get<Run>(RUN);
}

/** Keeps a run in place of the one before. Throws where the browser has no room. */
export async function keep(run: Run): Promise<void> {
  await set(RUN, run);
}

export async function forgetRun(): Promise<void> {
  await del(RUN);
}

/** Works while no other tab of this page does: soon, or with `wait` as soon as none does any more. */
export async function alone(wait: boolean, work: () => Promise<void>): Promise<void> {
  // Only a page that came over HTTPS, or from this machine, has locks.
  if (!("locks" in navigator)) return work();
  let isOurs = false;
  try {
    await navigator.locks.request(LOCK, wait ? {} : { signal: AbortSignal.timeout(LEAVING) }, () => {
      isOurs = true;
      return work();
    });
  } catch (thrown) {
    if (isOurs) throw thrown;
    throw new Error("A run is active in another tab of this page. Stop it there first.", { cause: thrown });
  }
}
