/** The clips that may be learned from: those that are kept, and examples. */
import type { TrainingClip } from "gravisight";
import { make, textButton } from "../dom";
import { tools } from "../shared/core";
import { simulatedClip } from "../shared/simulated";
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
      const watch = { signal, progress: (done: number, of: number | null) => progress((number + done / (of ?? 1)) / EXAMPLES) };
      const { clip, seen } = await simulatedClip(simulator, SEED, number, watch);
      await workspace.keep({ ...clip, id: `Example, camera ${camera}, throw ${number + 1}`, labels: seen, heldOut: number === EXAMPLES - 1 });
    }
  } finally {
    simulator.dispose();
  }
}
