/** Labelled frames of the clip held out, as a model sees them: before and after. */
import { Localiser, type Localisation, type Model } from "gravisight";
import { contextOf, make } from "../dom";
import type { Pixel } from "../shared/canvas";
import { seenIn } from "../shared/clip";
import { followed } from "../shared/follow";
import type { Watch } from "../shared/job";
import { drawFound, drawTruth } from "../shared/marks";
import type { StoredClip } from "../shared/workspace";
import type { ReadyClip } from "./check";

/** Frames that are looked at, and those of them that are shown, at most. */
const MOST = 20;
const SHOWN = 3;
/** A ball counts as found so near to its label, or within its own radius, pixels. */
const NEAR = 2;

/** What a model finds in a frame. */
export interface Look extends Pick<Localisation, "image" | "depth" | "ballFound" | "radiusPx" | "dtg"> {
  frame: number;
}

/** What the model finds in frames with a label, spread over the clip. */
export async function looksOf(model: string | Model, clip: ReadyClip, signal: AbortSignal, progress: (fraction: number) => void): Promise<Look[]> {
  const localiser = await Localiser.create({ model, camera: clip.camera, ball: clip.scene.ball, threads: "auto", signal });
  try {
    const looks: Look[] = [];
    const frames = spread(seenIn(clip), MOST);
    for (const frame of frames) {
      progress(looks.length / frames.length);
      const picture = clip.pictures[frame];
      const truth = clip.truth?.[frame];
      if (!picture) continue;
      const { image, depth, ballFound, radiusPx, dtg } = await localiser.localise(picture, { ...(truth && { truth }), signal });
      looks.push({ frame, image, depth, ballFound, ...(radiusPx !== undefined && { radiusPx }), ...(dtg !== undefined && { dtg }) });
    }
    return looks;
  } finally {
    localiser.dispose();
  }
}

/** In how many of the frames the ball was found where its label is. */
export function foundIn({ labels }: StoredClip, looks: Look[]): number {
  return looks.filter(({ frame, image, ballFound, radiusPx }) => ballFound && isNear(image, labels[frame], radiusPx)).length;
}

/** In how many of the labelled frames a tracker with this model finds the ball where its label is. */
export async function followedIn(model: string | Model, clip: ReadyClip, watch: Watch): Promise<number> {
  const { frames } = await followed(clip, model, watch);
  return seenIn(clip).filter((frame) => isNear(frames[frame]?.image, clip.labels[frame], frames[frame]?.radiusPx)).length;
}

function isNear(at: Pixel | null | undefined, label: Pixel | null | undefined, radius: number | null | undefined): boolean {
  return Boolean(at && label && (at[0] - label[0]) ** 2 + (at[1] - label[1]) ** 2 <= Math.max(NEAR, radius ?? 0) ** 2);
}

/** Pictures of some of the frames. */
export async function figuresOf(clip: StoredClip, before: Look[], now: Look[]): Promise<HTMLElement[]> {
  const figures: HTMLElement[] = [];
  for (const look of spread(now, SHOWN)) {
    const picture = clip.pictures[look.frame];
    const first = before.find(({ frame }) => frame === look.frame);
    if (!picture || !first) continue;
    const canvas = await drawn(picture, clip.labels[look.frame] ?? undefined, look.image);
    const off = ({ dtg, depth, ballFound }: Look) => (!ballFound ? "no ball found" : dtg === undefined ? `${depth.toFixed(2)} m away` : `${(100 * dtg).toFixed(1)} cm off`);
    figures.push(make("figure", {}, canvas, make("figcaption", { text: `Frame ${look.frame + 1}: ${off(first)} before, ${off(look)} now` })));
  }
  return figures;
}

/** At most `most` of them, from the start to the end. */
function spread<T>(all: T[], most: number): T[] {
  const count = Math.min(most, all.length);
  return Array.from({ length: count }, (_, index) => all[Math.floor(((index + 0.5) * all.length) / count)]!);
}

async function drawn(picture: Blob, label: [number, number] | undefined, found: [number, number]): Promise<HTMLCanvasElement> {
  const bitmap = await createImageBitmap(picture);
  const canvas = make("canvas");
  const scale = 448 / bitmap.width;
  [canvas.width, canvas.height] = [448, Math.round(bitmap.height * scale)];
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "A frame of the held-out clip with the detected ball and its label");
  const context = contextOf(canvas);
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  drawFound(context, [(found[0] + 0.5) * scale, (found[1] + 0.5) * scale]);
  if (label) drawTruth(context, [(label[0] + 0.5) * scale, (label[1] + 0.5) * scale]);
  return canvas;
}
