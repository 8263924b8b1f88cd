import type { Camera } from "gravisight";

/** What the page looks at: a picture and the camera that took it. */
export interface Subject {
  name: string;
  picture: Blob;
  camera: Camera;
  /** Where the ball truly is, for samples. */
  truth?: { world: [number, number, number]; image: [number, number] };
}
