/** One localiser at a time. The old one serves until the new one is ready. */
import { Localiser, type DeviceChoice, type Progress } from "gravisight";
import { loadable } from "../shared/models";

export class Session {
  #localiser: Localiser | undefined;
  #choice: DeviceChoice | undefined;
  #loading: AbortController | undefined;

  /** The localiser that is ready, if there is one. */
  get localiser(): Localiser | undefined {
    return this.#localiser;
  }

  /** The choice that the localiser was made for. */
  get choice(): DeviceChoice | undefined {
    return this.#choice;
  }

  get isLoading(): boolean {
    return this.#loading !== undefined;
  }

  /** Loads a model for a device; false where a later choice overtook this one. */
  async load(model: string, device: DeviceChoice, onProgress: (progress: Progress) => void): Promise<boolean> {
    this.#loading?.abort();
    const loading = new AbortController();
    this.#loading = loading;
    try {
      const localiser = await Localiser.create({ model: await loadable(model), device, signal: loading.signal, onProgress });
      this.discard();
      this.#localiser = localiser;
      this.#choice = device;
      return true;
    } catch (thrown) {
      if (loading.signal.aborted) return false;
      throw thrown;
    } finally {
      if (this.#loading === loading) this.#loading = undefined;
    }
  }

  /** Ends the localiser, if there is one. */
  discard(): void {
    this.#localiser?.dispose();
    this.#localiser = undefined;
    this.#choice = undefined;
  }
}
