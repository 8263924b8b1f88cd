/** Where clips come from: a video, pictures, the simulator. */
import type { Camera } from "gravisight";
import { blobOf, decode, keptAs } from "../shared/canvas";
import { tools } from "../shared/core";
import { Film } from "../shared/film";
import { freeId } from "../shared/flights";
import type { Watch } from "../shared/job";
import { simulatedClip } from "../shared/simulated";
import { workspace, type StoredClip } from "../shared/workspace";

const MOST_SYNTHETIC = 90;
const SEED = 1;

/** Pictures that are being made into files, at most: each is a copy of a frame. */
const MOST_WAITING = 4;

/** The size of frames, their camera where it is for that size, and why there is none. */
interface Fitting {
  file: string;
  size: { width: number; height: number };
  camera?: Camera;
  note: string;
}

/** A clip that was read, and what a person should know of it; empty where there is nothing. */
export interface ReadClip {
  clip: StoredClip;
  note: string;
}

/** A video's first frames, `most` of them, with the times that the file gives them. `fps` counts only where the browser cannot decode the file. */
export async function clipOfVideo(file: File, fps: number, most: number, camera: Camera | undefined, watch: Watch): Promise<ReadClip> {
  // Loaded only here: it is large.
  const video = await (await import("../shared/decoded")).DecodedVideo.open(file);
  if (!video) return played(file, fps, most, camera, watch);
  try {
    const times: number[] = [];
    const pictures: Promise<Blob>[] = [];
    let about: Fitting = { file: file.name, size: { width: 0, height: 0 }, note: "" };
    for await (const { picture, timeMs } of video.frames()) {
      watch.signal.throwIfAborted();
      if (times.length === 0) about = fitting(picture, camera, file.name);
      times.push(timeMs / 1000);
      const waiting = blobOf(picture as HTMLCanvasElement, keptAs(picture));
      // It is awaited later.
      waiting.catch(() => {});
      pictures.push(waiting);
      watch.progress(times.length, most, `Reading frame ${times.length}`);
      await pictures.at(-MOST_WAITING);
      if (times.length === most) break;
    }
    if (times.length === 0) throw new Error(`${file.name} has no frames.`);
    const clip = await ownClip(nameWithout(file), await Promise.all(pictures), rateOf(times, fps), about);
    return { clip: { ...clip, times, timesKnown: true }, note: [video.broken, about.note].filter(Boolean).join(" ") };
  } finally {
    video.close();
  }
}

/** The same by the browser's own player, which is slow and does not tell the frames' times: it is asked for `fps` pictures a second. */
async function played(file: File, fps: number, most: number, camera: Camera | undefined, watch: Watch): Promise<ReadClip> {
  const film = await Film.open(file);
  try {
    const count = Math.max(1, Math.min(most, Math.floor(film.duration * fps + 1e-6)));
    const pictures: Blob[] = [];
    for (let frame = 0; frame < count; frame++) {
      watch.signal.throwIfAborted();
      watch.progress(frame, count, `Reading frame ${frame + 1} of ${count}`);
      // The middle of a frame's time: its edge may belong to either neighbour.
      pictures.push(await film.frame((frame + 0.5) / fps));
    }
    const about = await fittingFile(pictures[0], camera, file.name);
    const times = `${file.name} cannot be decoded here, so the page took ${fps} frames a second. Their times may be wrong, but physics needs the true ones.`;
    return { clip: await ownClip(nameWithout(file), pictures, fps, about), note: [times, about.note].filter(Boolean).join(" ") };
  } finally {
    film.close();
  }
}

/** Pictures as frames, in the order of their names. */
export async function clipOfPictures(files: File[], fps: number, most: number, camera: Camera | undefined): Promise<ReadClip> {
  const sorted = [...files].sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true })).slice(0, most);
  const first = sorted[0]?.name ?? "pictures";
  const about = await fittingFile(sorted[0], camera, first);
  return { note: about.note, clip: await ownClip(first.replace(/\.[^.]+$/, "").replace(/[\s_-]*\d+$/, "") || "pictures", sorted, fps, about) };
}

async function fittingFile(picture: Blob | undefined, camera: Camera | undefined, name: string): Promise<Fitting> {
  if (!picture) throw new Error(`${name} has no frames.`);
  const bitmap = await decode(picture, name);
  const { width, height } = bitmap;
  bitmap.close();
  return fitting({ width, height }, camera, name);
}

/** The camera where it is for frames of this size; else none, and why. */
function fitting({ width, height }: { width: number; height: number }, camera: Camera | undefined, name: string): Fitting {
  const read = { file: name, size: { width, height }, note: "" };
  if (!camera) return read;
  const later = "The clip has no camera for now:";
  if (width !== camera.width || height !== camera.height) {
    const sizes = `The frames of ${name} have ${width} × ${height} pixels; the camera was calibrated for ${camera.width} × ${camera.height}.`;
    return { ...read, note: `${sizes} ${later} calibrate one on a frame of this clip.` };
  }
  const { of = [] } = workspace.cameraAbout ?? {};
  if (of.length === 0 || of.includes(name)) return { ...read, camera };
  return { ...read, note: `The camera was calibrated on ${of.join(" and ")}. ${later} if it also took ${name}, press “Use the calibrated camera for this clip”.` };
}

/** Frames a second, on average. */
function rateOf(times: number[], otherwise: number): number {
  const [first = 0, last = 0] = [times[0], times.at(-1)];
  return last > first ? Number(((times.length - 1) / (last - first)).toFixed(3)) : otherwise;
}

function nameWithout(file: File): string {
  return file.name.replace(/\.[^.]+$/, "");
}

async function ownClip(id: string, pictures: Blob[], fps: number, { file, size, camera }: Fitting): Promise<StoredClip> {
  const scene = workspace.ownScene;
  return {
    id: await freeId(id),
    file,
    fps,
    size,
    ...(camera && { camera }),
    ...(scene && { scene }),
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
