/** Cameras as people have them: files, and a phone's that is assumed. */
import type { Camera } from "gravisight";
import { tools } from "./core";
import { readJson } from "./files";
import { focalOfPicture, focalOfVideo } from "./lens";

/** A camera, and how unsure it is. */
export interface KnownCamera {
  /** Where it comes from, in words. */
  name: string;
  camera: Camera;
  /** The camera displaced by one standard deviation each; empty where that is not known. */
  oneSigma: Camera[];
  /** What was assumed, in words; empty where nothing was. */
  note: string;
}

/** The camera in a JSON file's content: a camera.json's, or what a calibration returns or prints. */
export function cameraIn(content: unknown): Pick<KnownCamera, "camera" | "oneSigma"> | undefined {
  if (typeof content !== "object" || content === null) return undefined;
  if ("intrinsic" in content && "camera_from_world" in content) return { camera: content as Camera, oneSigma: [] };
  const { camera, oneSigma, one_sigma } = content as { camera?: Camera; oneSigma?: Camera[]; one_sigma?: Camera[] };
  return camera && "intrinsic" in Object(camera) ? { camera, oneSigma: oneSigma ?? one_sigma ?? [] } : undefined;
}

/** The camera of a file, if the core has nothing against it. */
export async function knownCameraFrom(file: File): Promise<KnownCamera> {
  const found = cameraIn(await readJson(file));
  if (!found) throw new Error(`${file.name} is not a camera.json: it needs width, height, intrinsic and camera_from_world.`);
  return checked({ ...found, name: file.name, note: "" });
}

/** Has the core look at a camera. */
export async function checked<T extends Pick<KnownCamera, "camera" | "oneSigma">>(known: T): Promise<T> {
  const core = await tools();
  // Any point will do.
  for (const camera of [known.camera, ...known.oneSigma]) await core.project(camera, [[0, 0, 0]]);
  return known;
}

/** A phone's camera, held level, of pictures of a size; with the focal length that `file` states. */
export async function assumedPhone({ width, height }: { width: number; height: number }, file: Blob | undefined, video: boolean): Promise<KnownCamera> {
  const focal35mm = file && (await (video ? focalOfVideo(file) : focalOfPicture(file)));
  const { camera, oneSigma, note } = await (await tools()).assumedCamera({ width, height, video, ...(focal35mm !== undefined && { focal35mm }) });
  return { name: "a phone, assumed", camera, oneSigma, note };
}
