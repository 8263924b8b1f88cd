/** The trajectory that physics makes of the detections. */
import { GravisightError, Track, type Camera, type Scene } from "gravisight";
import { messageOf } from "../dom";
import { tools } from "../shared/core";
import type { Curve, FrameDetection } from "./detections";

export interface FitOptions {
  camera: Camera;
  cameraSigma: Camera[];
  /** Whether it is assumed and not measured. */
  cameraAssumed: boolean;
  scene: Scene;
  /** Least confidence of a detection. */
  threshold: number;
  /** Of the video, pixels. */
  size: { width: number; height: number };
  signal: AbortSignal;
}

export async function fitted(all: FrameDetection[], { camera, cameraSigma, cameraAssumed, scene, threshold, size, signal }: FitOptions): Promise<Curve> {
  const track = await Track.create({ camera, cameraSigma, cameraAssumed, scene, toolbox: await tools(), leastConfidence: threshold });
  for (const { filmed, image: [u, v], confidence } of all) {
    // In the pixels that the camera speaks of, which need not be the video's; an integer is a pixel's centre.
    const image: [number, number] = [((u + 0.5) * camera.width) / size.width - 0.5, ((v + 0.5) * camera.height) / size.height - 0.5];
    track.add({ timestampMs: 1000 * filmed, image, confidence });
  }
  const fit = await track.fit({ signal }).catch((thrown: unknown) => {
    if (!(thrown instanceof GravisightError) || thrown.code !== "fit") throw thrown;
    throw new Error(`The trajectory could not be fitted: ${messageOf(thrown).replace(/^fit: /, "")}.`);
  });
  return { ...fit, flat: false };
}
