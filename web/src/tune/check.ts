/** Whether clips can be learned from, before a run begins: each must be one trajectory that physics explains. */
import type { Camera, Fit, Observation, Scene } from "gravisight";
import { messageOf } from "../dom";
import { isRepeated, seenIn, timeOf } from "../shared/clip";
import { tools } from "../shared/core";
import type { StoredClip } from "../shared/workspace";

/** Fraction of the labels that may lie off the trajectory, as the core has it. */
const MOST_OUTLIERS = 0.2;

/** A clip with all that learning needs. */
export type ReadyClip = StoredClip & { camera: Camera; scene: Scene };

/** The clip, if nothing is missing. Throws in words. */
export function ready(clip: StoredClip): ReadyClip {
  const missing = [!clip.camera && "its camera", !clip.scene && "its place and ball", seenIn(clip).length === 0 && "its labels"].filter(Boolean);
  if (missing.length > 0) throw new Error(`“${clip.id}” lacks ${missing.join(" and ")}. Open it in the step Label.`);
  return clip as ReadyClip;
}

/** Fits the labels as learning would. Throws in words where physics does not explain them. */
export async function check(clip: ReadyClip, signal: AbortSignal): Promise<void> {
  const { camera, scene } = clip;
  const track = clip.labels.flatMap((label, frame): Observation[] => (isRepeated(clip, frame) ? [] : [{ time: timeOf(clip, frame), image: label ?? null }]));
  const fit = await (await tools()).fitTrack(track, { camera, scene, signal }).catch((thrown: unknown) => {
    signal.throwIfAborted();
    throw new Error(refusalOf(clip, messageOf(thrown).replace(/^fit: /, "")));
  });
  const reason = reasonOf(fit, seenIn(clip).length);
  if (reason) throw new Error(refusalOf(clip, reason));
}

/** Why the labels are not one trajectory; empty where they are. */
function reasonOf({ explained, findings, verdict, frames }: Fit, labels: number): string {
  if (!explained) return findings.reasons[0]?.why ?? verdict;
  const off = frames.filter(({ outlier, refused }) => outlier && refused === null).length;
  return off > MOST_OUTLIERS * labels ? `${off} of its ${labels} labels are not on its trajectory` : "";
}

function refusalOf({ id, scene, truth }: ReadyClip, reason: string): string {
  const ball = truth ? "" : ` its ball (${(200 * scene.ball.radius).toFixed(1)} cm across),`;
  return `Physics does not explain the labels of “${id}”: ${reason.replace(/\.?$/, ".")} In the step Label, cut a clip with hits or catches into flights. Otherwise, check its labels,${ball} its place and its camera.`;
}
