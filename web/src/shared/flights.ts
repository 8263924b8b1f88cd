/** A clip cut into its flights: physics explains one trajectory, so hits and catches have to lie between clips. */
import type { TrackedVideo } from "gravisight";
import { isRepeated } from "./clip";
import { workspace, type StoredClip } from "./workspace";

/** Confidence of what the tracker says of an explained flight, above which it is a label. */
const SURE = 0.5;
/** Fewest labels of a flight that something can be learned from. */
const FEWEST = 5;

/** From one contact that the scene does not explain to the next: a hit, a catch. */
export interface ClipFlight {
  /** Its first and its last frame. */
  from: number;
  to: number;
  /** Why it is not explained, in words; null where it is. */
  reason: string | null;
}

/** What a tracker says of the ball in a frame. */
type Seen = { image: [number, number]; confidence: number; outlier?: boolean } | null | undefined;

export interface Cut {
  clips: StoredClip[];
  /** What was left out, and why, in words; empty where nothing was. */
  leftOut: string[];
}

export function flightsOf({ frames, flights }: TrackedVideo): ClipFlight[] {
  return flights.flatMap(({ reason }, flight) => {
    const own = frames.flatMap((frame, index) => (frame.flight === flight ? [index] : []));
    const [from, to] = [own[0], own.at(-1)];
    return from === undefined || to === undefined ? [] : [{ from, to, reason }];
  });
}

/** One clip a flight that physics explains. A person's labels stay; else what the tracker has `seen` on the trajectory counts. */
export async function cutIntoFlights(clip: StoredClip, flights: ClipFlight[], seen: (frame: number) => Seen): Promise<Cut> {
  const cut: Cut = { clips: [], leftOut: [] };
  for (const [index, { from, to, reason }] of flights.entries()) {
    const name = `Flight ${index + 1} (${seconds(clip, from)}–${seconds(clip, to)} s)`;
    const of = <T>(all: readonly T[]) => all.slice(from, to + 1);
    const labels = of(clip.labels).map((label, offset) => {
      const at = seen(from + offset);
      return label === undefined && at && !at.outlier && at.confidence >= SURE ? at.image : label;
    });
    const labelled = labels.filter((label, offset) => label && !isRepeated(clip, from + offset)).length;
    if (reason !== null) cut.leftOut.push(`${name} is left out: ${reason.replace(/\.?$/, ".")}`);
    else if (labelled < FEWEST) cut.leftOut.push(`${name} is left out: it has only ${labelled} labels.`);
    else {
      const { truth, filmed, repeated } = clip;
      const parts = { ...(truth && { truth: of(truth) }), ...(filmed && { filmed: of(filmed) }), ...(repeated && { repeated: of(repeated) }) };
      const id = await freeId(`${clip.id}, flight ${index + 1}`);
      cut.clips.push({ ...clip, ...parts, id, pictures: of(clip.pictures), times: of(clip.times), labels, heldOut: false });
    }
  }
  return cut;
}

/** What came of it, in words. */
export function cutText({ clips, leftOut }: Cut): string {
  const made = clips.length === 1 ? "One clip was made." : clips.length === 0 ? "No clip was made." : `${clips.length} clips were made, one per flight.`;
  const kept = clips.length > 0 ? "Kept: the labels, and the positions that physics confirms." : "";
  return [made, kept, ...leftOut].filter(Boolean).join(" ");
}

/** An id that no kept clip has. */
export async function freeId(preferred: string): Promise<string> {
  const taken = new Set(await workspace.clips());
  for (let number = 2, id = preferred; ; number++) {
    if (!taken.has(id)) return id;
    id = `${preferred} (${number})`;
  }
}

function seconds(clip: StoredClip, frame: number): string {
  return (clip.times[frame] ?? 0).toFixed(2);
}
