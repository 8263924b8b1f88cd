/** The model of this step: loaded when it is first needed, gone when the video is closed. */
import { Localiser, type DeviceChoice } from "gravisight";
import { chosenModel } from "../shared/core";
import type { Watch } from "../shared/job";
import { loadable } from "../shared/models";

/** Where the card says nothing. */
const USUAL_THRESHOLD = 0.5;

export class Model {
  /** Found with less confidence, a position is not to be trusted. It stays when the model goes, as what was found does. */
  threshold = USUAL_THRESHOLD;
  #localiser: Localiser | undefined;
  #loaded: string | undefined;

  get localiser(): Localiser | undefined {
    return this.#localiser;
  }

  /** Loads the model of a choice of this step; where that is the usual one, the one of the step Try. */
  async load(choice: string, { signal, progress }: Watch): Promise<void> {
    const model = choice === "any" ? chosenModel() : choice;
    if (this.#localiser && this.#loaded === model) return;
    this.dispose();
    this.#localiser = await Localiser.create({
      model: await loadable(model),
      device: chosenDevice(),
      signal,
      onProgress: ({ stage, loaded, total }) => stage === "weights" && progress(loaded, total),
    });
    this.#loaded = model;
    this.threshold = this.#localiser.card.confidence_threshold ?? USUAL_THRESHOLD;
  }

  dispose(): void {
    this.#localiser?.dispose();
    this.#localiser = undefined;
  }
}

/** The one that is chosen in the step Try. */
export function chosenDevice(): DeviceChoice {
  const chosen = document.querySelector<HTMLInputElement>('#device input[name="device"]:checked')?.value;
  return chosen === "webgpu" || chosen === "auto" ? chosen : "cpu";
}
