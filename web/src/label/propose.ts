/** Proposals for a clip: the ball as a {@link VideoTracker} follows it, and its flights where camera, place and ball are known. */
import { VideoTracker, type Model, type TrackedVideo } from "gravisight";
import { decode, type Pixel } from "../shared/canvas";
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
  /** Whether it is not on the trajectory of its flight. */
  outlier?: boolean;
}

/** A flight from contact to contact that the scene does not explain: a hit, a catch. */
export interface ClipFlight {
  /** Its first and its last frame. */
  from: number;
  to: number;
  /** Why it is not explained, in words; null where it is. */
  reason: string | null;
}

export interface Proposed {
  /** One a frame; null where the ball is not seen. */
  proposals: (Proposal | null)[];
  /** Undefined without camera, place and ball. */
  flights: ClipFlight[] | undefined;
  /** Undefined where all frames are pictures of their own, taken at their own times. */
  filmed: number[] | undefined;
  repeated: boolean[] | undefined;
}

export async function proposalsFor({ camera, scene, pictures, times, timesKnown = false }: StoredClip, model: string | Model, { signal, progress }: Watch): Promise<Proposed> {
  const onProgress = ({ stage, loaded, total }: { stage: string; loaded: number; total: number | null }) => stage === "weights" && progress(loaded, total, "Loading the model…");
  const tracker = await VideoTracker.create({ threads: "auto", ...(camera && { camera }), model, signal, onProgress });
  signal.addEventListener("abort", () => tracker.dispose(), { once: true });
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
    return proposedBy(await tracker.track({ ...(camera && scene && { camera, scene }), timesKnown, signal }));
  } finally {
    tracker.dispose();
  }
}

function proposedBy({ frames, flights, explained }: TrackedVideo): Proposed {
  const isRepeated = frames.some(({ repeated }) => repeated);
  return {
    proposals: frames.map(({ image, radiusPx, confidence, outlier }) => image && { image, radiusPx, confidence, doubtful: confidence < DOUBTFUL, outlier }),
    flights: explained === null ? undefined : flights.flatMap(({ reason }, flight) => {
      const own = frames.flatMap((frame, index) => (frame.flight === flight ? [index] : []));
      const [from, to] = [own[0], own.at(-1)];
      return from === undefined || to === undefined ? [] : [{ from, to, reason }];
    }),
    filmed: isRepeated ? frames.map(({ time }) => time) : undefined,
    repeated: isRepeated ? frames.map(({ repeated }) => repeated) : undefined,
  };
}
