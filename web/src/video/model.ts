/** The model of this step: loaded when it is first needed, gone when the video is closed. */
import { Localiser, type DeviceChoice, type Progress } from "gravisight";
import { MODEL } from "../shared/core";

/** Where the card says nothing. */
const USUAL_THRESHOLD = 0.5;

export class Model {
  /** Found with less confidence, a position is not to be trusted. */
  threshold = USUAL_THRESHOLD;
  #localiser: Localiser | undefined;

  get localiser(): Localiser | undefined {
    return this.#localiser;
  }

  async load(signal: AbortSignal, onProgress: (progress: Progress) => void): Promise<Localiser> {
    if (this.#localiser) return this.#localiser;
    const [localiser, threshold] = await Promise.all([
      Localiser.create({ model: MODEL, device: chosenDevice(), signal, onProgress }),
      thresholdOf(MODEL, signal),
    ]);
    this.threshold = threshold;
    return (this.#localiser = localiser);
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
