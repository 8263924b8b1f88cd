/** The ball through a kept clip, as a {@link VideoTracker} follows it; its flights where camera, place and ball are known. */
import { VideoTracker, type Model, type TrackedVideo } from "gravisight";
import { decode } from "./canvas";
import type { Watch } from "./job";
import type { StoredClip } from "./workspace";

export async function followed({ camera, scene, pictures, times, timesKnown = false }: StoredClip, model: string | Model, { signal, progress }: Watch): Promise<TrackedVideo> {
  const onProgress = ({ stage, loaded, total }: { stage: string; loaded: number; total: number | null }) => stage === "weights" && progress(loaded, total, "Loading the model…");
  const tracker = await VideoTracker.create({ threads: "auto", ...(camera && { camera }), model, signal, onProgress });
  const end = () => tracker.dispose();
  signal.addEventListener("abort", end, { once: true });
  try {
    for (const [frame, picture] of pictures.entries()) {
      signal.throwIfAborted();
      progress(frame, pictures.length, `Looking for the ball in frame ${frame + 1} of ${pictures.length}`);
      const bitmap = await decode(picture, `Frame ${frame + 1}`);
      try {
        if (camera && (bitmap.width !== camera.width || bitmap.height !== camera.height)) {
          throw new Error(`Frame ${frame + 1} has ${bitmap.width} × ${bitmap.height} pixels, but the clip’s camera is for ${camera.width} × ${camera.height}.`);
        }
        await tracker.add(bitmap, 1000 * (times[frame] ?? 0));
      } finally {
        bitmap.close();
      }
    }
    progress(0, null, "Finding the flights…");
    return await tracker.track({ ...(camera && scene && { camera, scene }), timesKnown, signal });
  } finally {
    signal.removeEventListener("abort", end);
    tracker.dispose();
  }
}
