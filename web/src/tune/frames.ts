/** Frames of the clip held out, before and after. */
import { Localiser, type FineTuner, type Localisation } from "gravisight";
import { contextOf, make } from "../dom";
import { drawFound, drawTruth } from "../shared/marks";
import type { StoredClip } from "../shared/workspace";

/** Frames that are shown. */
const SHOWN = 3;

/** Spread over those with a label. */
function framesOf({ labels }: StoredClip): number[] {
  const seen = labels.flatMap((label, index) => (label ? [index] : []));
  return Array.from({ length: Math.min(SHOWN, seen.length) }, (_, index) => seen[Math.floor(((index + 0.5) * seen.length) / SHOWN)] ?? 0);
}

/** What the model at the URL `model` finds in them. */
export async function framesBefore(model: string, clip: StoredClip, signal: AbortSignal): Promise<Localisation[]> {
  const localiser = await Localiser.create({ model, camera: clip.camera, ball: clip.scene.ball, signal });
  try {
    const found: Localisation[] = [];
    for (const frame of framesOf(clip)) {
      const picture = clip.pictures[frame];
      if (picture) found.push(await localiser.localise(picture, { ...truthOf(clip, frame), signal }));
    }
    return found;
  } finally {
    localiser.dispose();
  }
}

/** They with what was found `before`, and what is found now. */
export async function figuresOf(clip: StoredClip, before: Localisation[], tuner: FineTuner, signal: AbortSignal): Promise<HTMLElement[]> {
  const figures: HTMLElement[] = [];
  for (const [index, frame] of framesOf(clip).entries()) {
    const picture = clip.pictures[frame];
    const first = before[index];
    if (!picture || !first) continue;
    const now = await tuner.localise(picture, { camera: clip.camera, ball: clip.scene.ball, ...truthOf(clip, frame), signal });
    const canvas = await drawn(picture, clip.labels[frame] ?? undefined, now.image);
    const off = (found: Localisation) => (found.dtg === undefined ? `${found.depth.toFixed(2)} m deep` : `${(100 * found.dtg).toFixed(1)} cm off`);
    figures.push(make("figure", {}, canvas, make("figcaption", { text: `Frame ${frame}: ${off(first)} before, ${off(now)} now` })));
  }
  return figures;
}

function truthOf({ truth }: StoredClip, frame: number): { truth?: [number, number, number] } {
  const world = truth?.[frame];
  return world ? { truth: world } : {};
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
