import type { Camera } from "gravisight";

/** What the page looks at: a picture and the camera that took it. */
export interface Subject {
  name: string;
  picture: Blob;
  camera: Camera;
  /** Its radius in m, where it is known; else what the page's field says. */
  ball?: { radius: number };
  /** Where the ball truly is, for samples. */
  truth?: { world: [number, number, number]; image: [number, number] };
}
