/** A clip made in the page, for those who have no video at hand: drawn by the core's own simulator. */
import type { Camera, Scene } from "gravisight";
import { tools } from "../shared/core";
import type { Watch } from "../shared/job";
import { PictureSource, type Frame } from "./sources";

/** Which of the simulator's clips: one with bounces in sight. */
const SEED = 2024;
const NUMBER = 3;

export interface Example {
  source: PictureSource;
  camera: Camera;
  scene: Scene;
}

export async function makeExample({ signal, progress }: Watch): Promise<Example> {
  const toolbox = await tools();
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const { camera, scene } = simulator;
  const frames: Frame[] = [];
  try {
    const clip = await simulator.clip(SEED, NUMBER);
    for (const { t, world } of clip.frames) {
      signal.throwIfAborted();
      const { data, width, height } = await simulator.picture(world);
      const picture = new ImageData(data, width, height);
      frames.push({ picture, image: await createImageBitmap(picture), timeMs: t * 1000, truth: world });
      progress(frames.length, clip.frames.length);
    }
    return { source: new PictureSource("Example clip", camera.width, camera.height, frames), camera, scene };
  } finally {
    simulator.dispose();
  }
}
