/** The clips that may be learned from: those that are kept, and examples. */
import type { TrainingClip } from "gravisight";
import { make, textButton } from "../dom";
import { isRepeated, seenIn, timeOf } from "../shared/clip";
import { tools } from "../shared/core";
import { simulatedClip } from "../shared/simulated";
import { workspace, type StoredClip } from "../shared/workspace";
import type { ReadyClip } from "./check";

/** Fewest labelled frames that physics can be fitted to with any hope. */
const FEWEST = 15;
/** Clips of an example, the last of them held out. */
const EXAMPLES = 5;
const SEED = 11;

/** A row of the list. */
export interface Choice {
  clip: StoredClip;
  use: HTMLInputElement;
  /** Whether a person has said whether it is used; else its labels decide. */
  isDecided: boolean;
  heldOut: HTMLInputElement;
  detail: HTMLElement;
  row: HTMLLIElement;
}

/** The list of kept clips. */
export class ClipChoices {
  all: Choice[] = [];
  readonly #list: HTMLElement;
  readonly #empty: HTMLElement;
  #updates = 0;

  constructor(list: HTMLElement, empty: HTMLElement) {
    this.#list = list;
    this.#empty = empty;
  }

  /** Shows the clips that are kept now; what was chosen stays. */
  async update(): Promise<void> {
    const update = ++this.#updates;
    const ids = await workspace.clips();
    const clips = await Promise.all(ids.map((id) => workspace.clip(id)));
    // A later one may have been faster.
    if (update !== this.#updates) return;
    this.all = clips.flatMap((clip) => {
      if (!clip) return [];
      const choice = this.all.find((each) => each.clip.id === clip.id) ?? choiceOf(clip);
      choice.clip = clip;
      choice.heldOut.checked = clip.heldOut;
      choice.detail.textContent = `, ${detailOf(clip)}`;
      if (!choice.isDecided) choice.use.checked = isUsable(clip);
      return [choice];
    });
    // Rows that stay keep the focus.
    const isSame = this.all.length === this.#list.childElementCount && this.all.every(({ row }, index) => row === this.#list.children[index]);
    if (!isSame) this.#list.replaceChildren(...this.all.map(({ row }) => row));
    this.#empty.hidden = this.all.length > 0;
  }
}

function choiceOf(clip: StoredClip): Choice {
  const box = (text: string, checked: boolean, name: string) => {
    const input = make("input", { part: name });
    input.type = "checkbox";
    input.checked = checked;
    return { input, label: make("label", { class: "check" }, input, document.createTextNode(text)) };
  };
  const use = box("use", isUsable(clip), "tune-use");
  const heldOut = box("held out", clip.heldOut, "tune-held-out");
  const forget = textButton("Delete…", "tune-delete", `Delete ${clip.id}`, () => {
    if (confirm(`Delete the clip "${clip.id}" from this browser?`)) void workspace.forget(clip.id);
  });
  const detail = make("span");
  const name = make("span", { class: "name" }, make("strong", { text: clip.id }), detail);
  const row = make("li", {}, use.label, name, heldOut.label, forget);
  const choice: Choice = { clip, use: use.input, isDecided: false, heldOut: heldOut.input, detail, row };
  choice.use.addEventListener("change", () => (choice.isDecided = true));
  choice.heldOut.addEventListener("change", () => void workspace.keep({ ...choice.clip, heldOut: choice.heldOut.checked }));
  return choice;
}

function isUsable(clip: StoredClip): boolean {
  return seenIn(clip).length >= FEWEST && clip.camera !== undefined && clip.scene !== undefined;
}

function detailOf(clip: StoredClip): string {
  const count = seenIn(clip).length;
  const few = count < FEWEST ? ` (${FEWEST} or more are needed)` : "";
  const missing = [!clip.camera && "no camera", !clip.scene && "no place and ball"].filter(Boolean).map((each) => `, ${each as string}`);
  return `${count} of ${clip.pictures.length} frames labelled${few}${missing.join("")}`;
}

/** What has to be ticked before a run can begin, in words; empty where nothing has to. */
export function missingIn(all: Choice[]): string {
  const used = all.filter(({ use }) => use.checked);
  const isHeld = ({ heldOut }: Choice) => heldOut.checked;
  const idle = all.filter((choice) => !choice.use.checked && isHeld(choice))[0];
  if (used.length === 0 || used.every(isHeld)) return "Choose at least one clip to learn from: tick “use”, but not “held out”.";
  if (used.some(isHeld)) return "";
  if (idle) return `“${idle.clip.id}” is held out, but not ticked “use”: tick it, so that the page can measure whether learning helped.`;
  return "Hold one clip out: tick “held out” on a clip in use. Without it, the page cannot measure whether learning helped.";
}

/** A kept clip as the package takes it. */
export function trainingClip(clip: ReadyClip): TrainingClip {
  const { id, fps, camera, scene, pictures, labels, truth } = clip;
  const frames = pictures.flatMap((picture, index) => {
    const world = truth?.[index];
    return isRepeated(clip, index) ? [] : [{ picture, t: timeOf(clip, index), image: labels[index] ?? null, ...(world && { world }) }];
  });
  return { id, fps, camera, scene, frames };
}

/** Draws clips of scene 1 before a camera and keeps them. */
export async function makeExamples(camera: number, progress: (fraction: number) => void, signal: AbortSignal): Promise<void> {
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
