/** Proposals for a whole clip, in parts that fit into memory. */
import type { LabelProposal } from "gravisight";
import { contextOf, make } from "../dom";
import { decode } from "../shared/canvas";
import { tools } from "../shared/core";
import type { Watch } from "../shared/job";
import type { StoredClip } from "../shared/workspace";

/** Pixels of all frames that the core looks at together: it holds them as numbers, a phone has room for so many. */
const MOST_PIXELS = 64e6;

export async function proposalsFor(clip: StoredClip, { signal, progress }: Watch): Promise<(LabelProposal | null)[]> {
  const toolbox = await tools();
  const { camera, pictures } = clip;
  const parts = Math.ceil((pictures.length * camera.width * camera.height) / MOST_PIXELS);
  const length = Math.ceil(pictures.length / parts);
  const proposals: (LabelProposal | null)[] = [];
  for (let from = 0; from < pictures.length; from += length) {
    const part: ImageData[] = [];
    for (const [index, picture] of pictures.slice(from, from + length).entries()) {
      signal.throwIfAborted();
      progress(from + index, pictures.length, `Opening frame ${from + index + 1} of ${pictures.length}`);
      part.push(await pixelsOf(picture, `Frame ${from + index + 1}`, camera));
    }
    progress(0, null, `Looking for the ball in ${part.length} frames…`);
    proposals.push(...(await toolbox.proposeLabels(part, { camera, signal })));
  }
  return proposals;
}

async function pixelsOf(picture: Blob, name: string, { width, height }: { width: number; height: number }): Promise<ImageData> {
  const bitmap = await decode(picture, name);
  try {
    if (bitmap.width !== width || bitmap.height !== height) {
      throw new Error(`${name} has ${bitmap.width} × ${bitmap.height} pixels, the clip’s camera ${width} × ${height}.`);
    }
    const canvas = make("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d", { willReadFrequently: true }) ?? contextOf(canvas);
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, width, height);
  } finally {
    bitmap.close();
  }
}
