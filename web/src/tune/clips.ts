/** The clips that may be learned from: those that are kept, and examples. */
import type { TrainingClip } from "gravisight";
import { make, textButton } from "../dom";
import { tools } from "../shared/core";
import { workspace, type StoredClip } from "../shared/workspace";

/** Fewest labelled frames that physics can be fitted to with any hope. */
const FEWEST = 15;
/** Clips of an example, the last of them held out. */
const EXAMPLES = 5;
const SEED = 11;

/** A row of the list. */
export interface Choice {
  clip: StoredClip;
  use: HTMLInputElement;
  heldOut: HTMLInputElement;
}

/** Shows the kept clips in `list`. */
export async function showClips(list: HTMLElement, empty: HTMLElement): Promise<Choice[]> {
  const choices: Choice[] = [];
  for (const id of await workspace.clips()) {
    const clip = await workspace.clip(id);
    if (clip) choices.push(choiceOf(clip));
  }
  list.replaceChildren(...choices.map(rowOf));
  empty.hidden = choices.length > 0;
  return choices;
}

function choiceOf(clip: StoredClip): Choice {
  const box = (checked: boolean, testId: string) => {
    const input = make("input", { testId });
    input.type = "checkbox";
    input.checked = checked;
    return input;
  };
  const choice = { clip, use: box(labelled(clip) >= FEWEST, "tune-use"), heldOut: box(clip.heldOut, "tune-held-out") };
  choice.heldOut.addEventListener("change", () => void workspace.keep({ ...clip, heldOut: choice.heldOut.checked }));
  return choice;
}

function labelled({ labels }: StoredClip): number {
  return labels.filter((label) => label).length;
}

function rowOf({ clip, use, heldOut }: Choice): HTMLLIElement {
  const words = `${labelled(clip)} of ${clip.pictures.length} frames labelled`;
  const label = (input: HTMLInputElement, text: string) => make("label", { class: "check" }, input, document.createTextNode(text));
  const forget = textButton("Delete…", "tune-delete", `Delete ${clip.id}`, () => {
    if (confirm(`Delete the clip "${clip.id}" from this browser?`)) void workspace.forget(clip.id);
  });
  const name = make("span", { class: "name" }, make("strong", { text: clip.id }), document.createTextNode(`, ${words}`));
  return make("li", {}, label(use, "use"), name, label(heldOut, "held out"), forget);
}

/** A kept clip as the package takes it. */
export function trainingClip({ id, fps, camera, scene, pictures, times, labels, truth }: StoredClip): TrainingClip {
  const frames = pictures.map((picture, index) => {
    const world = truth?.[index];
    return { picture, t: times[index] ?? index / fps, image: labels[index] ?? null, ...(world && { world }) };
  });
  return { id, fps, camera, scene, frames };
}

/** Draws clips of scene 1 before a camera and keeps them. */
export async function makeExamples(camera: number, progress: (share: number) => void, signal: AbortSignal): Promise<void> {
  const toolbox = await tools();
  const simulator = await toolbox.simulator({ environment: 1, camera });
  try {
    for (let number = 0; number < EXAMPLES; number++) {
      const { fps, frames } = await simulator.clip(SEED, number);
      const pictures: Blob[] = [];
      for (const [index, { world }] of frames.entries()) {
        signal.throwIfAborted();
        const { data, width, height } = await simulator.picture(world);
        pictures.push(await png(new ImageData(data, width, height)));
        progress((number + (index + 1) / frames.length) / EXAMPLES);
      }
      await workspace.keep({
        id: `Example, camera ${camera}, throw ${number + 1}`,
        fps,
        camera: simulator.camera,
        scene: simulator.scene,
        pictures,
        times: frames.map(({ t }) => t),
        labels: frames.map(({ image, visible }) => (visible ? image : null)),
        truth: frames.map(({ world }) => world),
        heldOut: number === EXAMPLES - 1,
      });
    }
  } finally {
    simulator.dispose();
  }
}

async function png(picture: ImageData): Promise<Blob> {
  const canvas = new OffscreenCanvas(picture.width, picture.height);
  canvas.getContext("2d")?.putImageData(picture, 0, 0);
  return canvas.convertToBlob({ type: "image/png" });
}
