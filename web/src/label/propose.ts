/** Proposals for a clip: the ball as a {@link VideoTracker} follows it. */
import { VideoTracker } from "gravisight";
import { decode, type Pixel } from "../shared/canvas";
import { MODELS } from "../shared/core";
import type { Watch } from "../shared/job";
import type { StoredClip } from "../shared/workspace";

/** Confidence below which a person should look at a proposal. */
const DOUBTFUL = 0.9;

export interface Proposal {
  image: Pixel;
  /** Pixels. */
  radiusPx: number | null;
  confidence: number;
  doubtful: boolean;
}

/** One a frame; null where the ball is not seen. */
export async function proposalsFor({ camera, pictures, times }: StoredClip, { signal, progress }: Watch): Promise<(Proposal | null)[]> {
  const tracker = await VideoTracker.create({ threads: "auto", camera, model: MODELS.any, signal, onProgress: ({ stage, loaded, total }) => stage === "weights" && progress(loaded, total, "Loading the model…") });
  signal.addEventListener("abort", () => tracker.dispose(), { once: true });
  try {
    for (const [frame, picture] of pictures.entries()) {
      signal.throwIfAborted();
      progress(frame, pictures.length, `Looking for the ball in frame ${frame + 1} of ${pictures.length}`);
      const bitmap = await decode(picture, `Frame ${frame + 1}`);
      try {
        if (bitmap.width !== camera.width || bitmap.height !== camera.height) {
          throw new Error(`Frame ${frame + 1} has ${bitmap.width} × ${bitmap.height} pixels, but the clip’s camera is for ${camera.width} × ${camera.height}.`);
        }
        await tracker.add(bitmap, 1000 * (times[frame] ?? 0));
      } finally {
        bitmap.close();
      }
    }
    const { frames } = await tracker.track({ signal });
    return frames.map(({ image, radiusPx, confidence }) => image && { image, radiusPx, confidence, doubtful: confidence < DOUBTFUL });
  } finally {
    tracker.dispose();
  }
}
