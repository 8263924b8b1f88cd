/** The model of this step: loaded when it is first needed, gone when the video is closed. */
import { Localiser, type DeviceChoice } from "gravisight";
import { MODEL } from "../shared/core";
import type { Watch } from "../shared/job";

/** Where the card says nothing. */
const USUAL_THRESHOLD = 0.5;

export class Model {
  /** Found with less confidence, a position is not to be trusted. */
  threshold = USUAL_THRESHOLD;
  #localiser: Localiser | undefined;

  get localiser(): Localiser | undefined {
    return this.#localiser;
  }

  async load({ signal, progress }: Watch): Promise<void> {
    if (this.#localiser) return;
    const [localiser, threshold] = await Promise.all([
      Localiser.create({
        model: MODEL,
        device: chosenDevice(),
        signal,
        onProgress: ({ stage, loaded, total }) => stage === "weights" && progress(loaded, total),
      }),
      thresholdOf(MODEL, signal),
    ]);
    this.threshold = threshold;
    this.#localiser = localiser;
  }

  dispose(): void {
    this.#localiser?.dispose();
    this.#localiser = undefined;
  }
}

/** The one that is chosen in the step Try. */
function chosenDevice(): DeviceChoice {
  const chosen = document.querySelector<HTMLInputElement>('#device input[name="device"]:checked')?.value;
  return chosen === "webgpu" || chosen === "auto" ? chosen : "cpu";
}

/** A card that cannot be had is the localiser's matter, which says so itself. */
async function thresholdOf(url: string, signal: AbortSignal): Promise<number> {
  const card = (await fetch(url, { signal })
    .then((response) => response.json())
    .catch(() => null)) as { confidence_threshold?: number } | null;
  return card?.confidence_threshold ?? USUAL_THRESHOLD;
}
