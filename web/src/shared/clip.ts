/** What follows from a kept clip. */
import type { StoredClip } from "./workspace";

/** Of its pictures, pixels. */
export function sizeOf({ size, camera }: StoredClip): { width: number; height: number } | undefined {
  return size ?? camera;
}

/** When a frame was filmed, seconds. */
export function timeOf({ filmed, times, fps }: StoredClip, frame: number): number {
  return filmed?.[frame] ?? times[frame] ?? frame / fps;
}

/** Whether a frame repeats the one before: then it says nothing of its own. */
export function isRepeated({ repeated }: StoredClip, frame: number): boolean {
  return repeated?.[frame] ?? false;
}

/** Frames with a ball that somebody has labelled. */
export function seenIn(clip: StoredClip): number[] {
  return clip.labels.flatMap((label, frame) => (label && !isRepeated(clip, frame) ? [frame] : []));
}
