/** The models that this browser keeps: a tuned one is kept under a name, and forgotten. */
import type { Model } from "gravisight";
import { make, textButton } from "../dom";
import { keptModels } from "../shared/models";
import type { Alert, Parts } from "../shared/panel";

export class KeptList {
  readonly #part: Parts;

  /** `model` gives the one that was tuned. */
  constructor(part: Parts, alert: Alert, model: () => Promise<Model | undefined>) {
    this.#part = part;
    part("tune-keep").addEventListener("click", () => void alert.during(async () => this.#keep(await model())));
    keptModels.addEventListener("change", () => void this.update().catch(() => undefined));
  }

  /** A name to keep the next one by. */
  offer(name: string): void {
    const input = this.#part<HTMLInputElement>("tune-name");
    if (!input.value) input.value = name;
  }

  async update(): Promise<void> {
    const names = await keptModels.names();
    this.#part("tune-kept").replaceChildren(
      ...names.map((name) => {
        const forget = textButton("Forget…", "tune-forget", `Forget ${name}`, () => {
          if (confirm(`Forget the model “${name}”? Download it first if you want to use it later.`)) void keptModels.forget(name);
        });
        return make("li", {}, make("span", { class: "name", text: name }), forget);
      }),
    );
    this.#part("tune-none-kept").hidden = names.length > 0;
  }

  async #keep(model: Model | undefined): Promise<void> {
    if (!model) return;
    const name = this.#part<HTMLInputElement>("tune-name").value.trim();
    if (!name) throw new Error("Give the model a name first.");
    await keptModels.keep(name, model);
    this.#part("tune-kept-said").textContent = `“${name}” is kept. Choose it in Try, Your video and Label.`;
  }
}
