/** A ball's 3D position from a single picture of one calibrated camera. */
export { Adapter } from "./adapter.js";
export { coreFiles } from "./builds.js";
export { clearCache, isCached } from "./cache.js";
export { GravisightError } from "./error.js";
export type { FacadeErrorCode } from "./error.js";
export { FineTuner } from "./fine-tuner.js";
export { Localiser } from "./localiser.js";
export { Simulator, Toolbox } from "./toolbox.js";
export type { SimulatedPicture } from "./toolbox.js";
export { Track } from "./track.js";
export type { Sighting, TrackOptions } from "./track.js";
export { VideoTracker } from "./video-tracker.js";
export type { Seed, TrackVideoOptions, VideoTrackerOptions } from "./video-tracker.js";
export type * from "./types.js";
