/** A choice between the published model for any ball and those that were tuned here. */
import { keptModels, MINE, readsSizes } from "./models";

/** Fills a select with the models that take balls of any size, now and later. `field` is seen only where there is a choice. */
export class ModelSelect {
  readonly #select: HTMLSelectElement;
  readonly #field: HTMLElement;

  constructor(select: HTMLSelectElement, field: HTMLElement) {
    this.#select = select;
    this.#field = field;
    keptModels.addEventListener("change", () => void this.#update());
    void this.#update();
  }

  /** As `loadable` takes it. */
  get choice(): string {
    return this.#select.value;
  }

  /** Chooses a model that was just kept. */
  async choose(choice: string): Promise<void> {
    await this.#update();
    this.#select.value = choice;
    this.#select.dispatchEvent(new Event("change", { bubbles: true }));
  }

  async #update(): Promise<void> {
    const names: string[] = [];
    try {
      for (const name of await keptModels.names()) if (await readsSizes(name)) names.push(name);
    } catch {
      // A browser that keeps nothing has the published one.
    }
    const chosen = this.#select.value;
    this.#select.replaceChildren(new Option("Any ball", "any"), ...names.map((name) => new Option(name, MINE + name)));
    if (names.some((name) => MINE + name === chosen)) this.#select.value = chosen;
    this.#field.hidden = names.length === 0;
  }
}
