import type { Camera } from "gravisight";

/** What the page looks at: a picture and the camera that took it. */
export interface Subject {
  name: string;
  picture: Blob;
  camera: Camera;
  /** The camera displaced by one standard deviation each, where that is known. */
  oneSigma?: Camera[];
  /** Its radius in m, of a sample; else what the page's field says. */
  ball?: { radius: number };
  /** What a person should know of the picture, in words. */
  note?: string;
  /** Where the ball truly is, for rendered samples. */
  truth?: { world: [number, number, number]; image: [number, number] };
}
