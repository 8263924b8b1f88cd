/** Proposals for a clip, of what the tracker found. */
import type { Model, TrackedVideo } from "gravisight";
import type { Pixel } from "../shared/canvas";
import { flightsOf, type ClipFlight } from "../shared/flights";
import { followed } from "../shared/follow";
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

export interface Proposed {
  /** One a frame; null where the ball is not seen. */
  proposals: (Proposal | null)[];
  /** Undefined without camera, place and ball. */
  flights: ClipFlight[] | undefined;
  /** What was found of the frames themselves. */
  about: Pick<StoredClip, "filmed" | "repeated">;
}

export async function proposalsFor(clip: StoredClip, model: string | Model, watch: Watch): Promise<Proposed> {
  const tracked = await followed(clip, model, watch);
  const proposals = tracked.frames.map(({ image, radiusPx, confidence, outlier }) => image && { image, radiusPx, confidence, doubtful: confidence < DOUBTFUL, outlier });
  return { proposals, flights: tracked.explained === null ? undefined : flightsOf(tracked), about: aboutFrames(tracked) };
}

/** When the frames were filmed, and which repeat another; nothing where all are pictures of their own. */
export function aboutFrames({ frames }: TrackedVideo): Pick<StoredClip, "filmed" | "repeated"> {
  if (!frames.some(({ repeated }) => repeated)) return {};
  return { filmed: frames.map(({ time }) => time), repeated: frames.map(({ repeated }) => repeated) };
}
