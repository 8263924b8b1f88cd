/** Clips for those who have no video at hand: one drawn in the page by the core's own simulator, a rally that was drawn before, and a real one. */
import type { Camera, Scene } from "gravisight";
import { tools } from "../shared/core";
import { fetchOk } from "../shared/files";
import type { Watch } from "../shared/job";
import { real, realUrl } from "../shared/real";
import { PictureSource, type Frame, type Source } from "./sources";
import { VideoSource } from "./video-source";

/** Which of the simulator's clips: one with bounces in sight. */
const SEED = 2024;
const NUMBER = 3;

export interface Example {
  source: Source;
  camera: Camera;
  scene: Scene;
  /** Whose camera and scene they are. */
  summary: string;
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
    return { source: new PictureSource("Example clip", camera.width, camera.height, frames), camera, scene, summary: "Camera and scene: the example’s own." };
  } finally {
    simulator.dispose();
  }
}

/** As in `public/rally/rally.json`. */
interface Rally {
  clip: string;
  sport: string;
  camera: Camera;
  /** What it is. */
  note: string;
}

/** A tennis rally on its court: hits, bounces, and a camera that is known. */
export async function rallyExample({ signal }: Watch): Promise<Example> {
  const folder = `${import.meta.env.BASE_URL}rally/`;
  const { clip, sport, camera, note } = (await (await fetchOk(`${folder}rally.json`)).json()) as Rally;
  const [scene, response] = await Promise.all([tools().then((toolbox) => toolbox.scene(sport)), fetchOk(folder + clip)]);
  const file = new File([await response.blob()], clip, { type: "video/mp4" });
  signal.throwIfAborted();
  return { source: await VideoSource.file(file), camera, scene, summary: note };
}

export async function realExample({ signal }: Watch): Promise<Example> {
  const toolbox = await tools();
  const [{ clip, camera, ball, note }, free] = await Promise.all([real(), toolbox.scene("free")]);
  const response = await fetchOk(realUrl(clip));
  const file = new File([await response.blob()], clip, { type: "video/mp4" });
  signal.throwIfAborted();
  return { source: await VideoSource.file(file), camera, scene: { ...free, ball: { ...free.ball, ...ball } }, summary: `${note} Errors in these assumptions appear in the estimated spin.` };
}
