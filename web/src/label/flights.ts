/** A clip cut into its flights: physics explains one trajectory, so hits and catches have to lie between clips. */
import { isRepeated } from "../shared/clip";
import type { StoredClip } from "../shared/workspace";
import type { Labelling } from "./labelling";
import { freeId } from "./sources";

/** Confidence of what the tracker says of an explained flight, above which it is a label. */
const SURE = 0.5;
/** Fewest labels of a flight that something can be learned from. */
const FEWEST = 5;

export interface Cut {
  clips: StoredClip[];
  /** What was left out, and why, in words; empty where nothing was. */
  leftOut: string[];
}

/** One clip a flight that physics explains. A person's labels stay; else those of the tracker that are on the trajectory count. */
export async function cutIntoFlights(labelling: Labelling): Promise<Cut> {
  const { clip, flights = [] } = labelling;
  const cut: Cut = { clips: [], leftOut: [] };
  for (const [index, { from, to, reason }] of flights.entries()) {
    const name = `Flight ${index + 1} (${seconds(clip, from)}–${seconds(clip, to)} s)`;
    const of = <T>(all: readonly T[]) => all.slice(from, to + 1);
    const labels = of(clip.labels).map((label, offset) => {
      const proposal = labelling.proposal(from + offset);
      return label === undefined && proposal && !proposal.outlier && proposal.confidence >= SURE ? proposal.image : label;
    });
    const labelled = labels.filter((label, offset) => label && !isRepeated(clip, from + offset)).length;
    if (reason !== null) cut.leftOut.push(`${name} is not explained: ${reason}.`);
    else if (labelled < FEWEST) cut.leftOut.push(`${name} has only ${labelled} labels.`);
    else {
      const { truth, filmed, repeated } = clip;
      const parts = { ...(truth && { truth: of(truth) }), ...(filmed && { filmed: of(filmed) }), ...(repeated && { repeated: of(repeated) }) };
      const id = await freeId(`${clip.id}, flight ${index + 1}`);
      cut.clips.push({ ...clip, ...parts, id, pictures: of(clip.pictures), times: of(clip.times), labels, heldOut: false });
    }
  }
  return cut;
}

function seconds(clip: StoredClip, frame: number): string {
  return (clip.times[frame] ?? 0).toFixed(2);
}
