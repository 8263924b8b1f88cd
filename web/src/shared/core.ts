/** What the steps share of the package: one toolbox, made when it is first needed. */
import { Toolbox, type Camera } from "gravisight";
import { readJson } from "./files";

let toolbox: Promise<Toolbox> | undefined;

/** The page's toolbox; a failed load is tried again by the next call. */
export function tools(): Promise<Toolbox> {
  toolbox ??= Toolbox.create().catch((thrown: unknown) => {
    toolbox = undefined;
    throw thrown;
  });
  return toolbox;
}

/** A camera.json that the core has nothing against. */
export async function cameraFrom(file: File): Promise<Camera> {
  const camera = (await readJson(file)) as Partial<Camera> | null;
  if (!camera?.width || !camera.height || !camera.intrinsic || !camera.camera_from_world) {
    throw new Error(`${file.name} is no camera.json: it needs width, height, intrinsic and camera_from_world.`);
  }
  // Any point will do to have the core look at it.
  await (await tools()).project(camera as Camera, [[0, 0, 0]]);
  return camera as Camera;
}

/** The page's model. */
export const MODEL = new URLSearchParams(location.search).get("model") ?? `${import.meta.env.BASE_URL}models/sd-l.json`;
