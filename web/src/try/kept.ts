/** The kept models beside the published ones, to choose from. */
import { element, make } from "../dom";
import { keptModels, MINE } from "../shared/models";

/** Shows those that there are, now and later; `gone` is called where the chosen one was forgotten. */
export async function showKeptModels(gone: () => void): Promise<void> {
  const place = element("model");
  const update = async () => {
    const chosen = place.querySelector<HTMLInputElement>("input:checked")?.value;
    const names = await keptModels.names();
    for (const old of place.querySelectorAll("label.kept")) old.remove();
    for (const name of names) {
      const input = make("input", { part: `model-kept-${name}` });
      Object.assign(input, { type: "radio", name: "model", value: MINE + name, checked: chosen === MINE + name });
      place.append(make("label", { class: "kept" }, input, make("span", { text: name })));
    }
    if (place.querySelector("input:checked")) return;
    place.querySelector<HTMLInputElement>('input[value="any"]')!.checked = true;
    gone();
  };
  keptModels.addEventListener("change", () => void update().catch(() => undefined));
  // A browser that keeps nothing has the published ones.
  await update().catch(() => undefined);
}
