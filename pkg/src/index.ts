/** A ball's 3D position from a single picture of one calibrated camera. */
export { GravisightError } from "./error.js";
export type { FacadeErrorCode } from "./error.js";
export { Localiser } from "./localiser.js";
export type { Maps } from "./raw.js";
export type {
  Camera,
  CreateOptions,
  Device,
  DeviceChoice,
  DeviceKind,
  DrawablePicture,
  FrameLocalisation,
  Localisation,
  LocaliseOptions,
  Picture,
  Progress,
} from "./types.js";
