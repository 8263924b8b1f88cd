/** Where clips come from: a video, pictures, the simulator. */
import type { Camera } from "gravisight";
import { decode } from "../shared/canvas";
import { tools } from "../shared/core";
import { Film } from "../shared/film";
import type { Watch } from "../shared/job";
import { simulatedClip } from "../shared/simulated";
import { workspace, type StoredClip } from "../shared/workspace";

const MOST_SYNTHETIC = 90;
const SEED = 1;

/** A video's frames, `fps` a second, `most` of them. */
export async function clipOfVideo(file: File, fps: number, most: number, camera: Camera, watch: Watch): Promise<StoredClip> {
  const film = await Film.open(file);
  try {
    const count = Math.max(1, Math.min(most, Math.floor(film.duration * fps + 1e-6)));
    const pictures: Blob[] = [];
    for (let frame = 0; frame < count; frame++) {
      watch.signal.throwIfAborted();
      watch.progress(frame, count, `Reading frame ${frame + 1} of ${count}`);
      // The middle of a frame's time: its edge may belong to either neighbour.
      pictures.push(await film.frame((frame + 0.5) / fps));
      // Before the user has waited for all of them.
      if (frame === 0) await check(pictures[0], camera, file.name);
    }
    return await ownClip(file.name.replace(/\.[^.]+$/, ""), pictures, fps, camera);
  } finally {
    film.close();
  }
}

/** Pictures as frames, in the order of their names. */
export async function clipOfPictures(files: File[], fps: number, most: number, camera: Camera): Promise<StoredClip> {
  const sorted = [...files].sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true })).slice(0, most);
  const first = sorted[0]?.name ?? "pictures";
  await check(sorted[0], camera, first);
  return ownClip(first.replace(/\.[^.]+$/, "").replace(/[\s_-]*\d+$/, "") || "pictures", sorted, fps, camera);
}

async function check(picture: Blob | undefined, camera: Camera, name: string): Promise<void> {
  if (!picture) throw new Error(`${name} has no frames.`);
  const bitmap = await decode(picture, name);
  const { width, height } = bitmap;
  bitmap.close();
  if (width === camera.width && height === camera.height) return;
  throw new Error(
    `The frames of ${name} have ${width} × ${height} pixels; the camera was calibrated for ${camera.width} × ${camera.height}. Calibrate with a frame of this video.`,
  );
}

async function ownClip(id: string, pictures: Blob[], fps: number, camera: Camera): Promise<StoredClip> {
  return {
    id: await freeId(id),
    fps,
    camera,
    scene: workspace.scene,
    pictures,
    times: pictures.map((_, frame) => frame / fps),
    labels: pictures.map(() => undefined),
    heldOut: false,
  };
}

export function syntheticId(environment: number, camera: number, number: number): string {
  return `env${environment}/cam${camera}/${String(number).padStart(4, "0")}`;
}

/** A simulated throw, drawn. */
export async function syntheticClip(environment: 1 | 2 | 3, camera: number, number: number, watch: Watch): Promise<StoredClip> {
  const simulator = await (await tools()).simulator({ environment, camera });
  try {
    const { clip } = await simulatedClip(simulator, SEED, number, watch, MOST_SYNTHETIC);
    return { ...clip, id: syntheticId(environment, camera, number), labels: clip.pictures.map(() => undefined), heldOut: false };
  } finally {
    simulator.dispose();
  }
}

/** An id that no kept clip has. */
async function freeId(preferred: string): Promise<string> {
  const taken = new Set(await workspace.clips());
  for (let number = 2, id = preferred; ; number++) {
    if (!taken.has(id)) return id;
    id = `${preferred} (${number})`;
  }
}
