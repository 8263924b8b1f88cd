/** Clips that the core simulates and draws. */
import type { Simulator } from "gravisight";
import { blobOf, canvasOf, type Pixel } from "./canvas";
import type { Watch } from "./job";
import type { StoredClip } from "./workspace";

export interface SimulatedClip {
  /** All of a clip but what a person decides. */
  clip: Omit<StoredClip, "id" | "labels" | "heldOut">;
  /** Where the ball is seen in each frame; null where it is not. */
  seen: (Pixel | null)[];
}

/** Draws one of the simulator's clips, `most` frames of it. */
export async function simulatedClip(simulator: Simulator, seed: number, number: number, { signal, progress }: Watch, most = Infinity): Promise<SimulatedClip> {
  const { fps, frames: all } = await simulator.clip(seed, number);
  const frames = all.slice(0, most);
  const pictures: Blob[] = [];
  for (const [index, { world }] of frames.entries()) {
    signal.throwIfAborted();
    progress(index, frames.length, `Drawing frame ${index + 1} of ${frames.length}`);
    const { data, width, height } = await simulator.picture(world);
    pictures.push(await blobOf(canvasOf(new ImageData(data, width, height)), "image/png"));
  }
  const { camera, scene } = simulator;
  const times = frames.map(({ t }) => t);
  const truth = frames.map(({ world }) => world);
  return { clip: { fps, camera, scene, pictures, times, truth }, seen: frames.map(({ image, visible }) => (visible ? image : null)) };
}
