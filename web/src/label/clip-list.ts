/** The clips that this browser keeps, to open and to delete. */
import { make, textButton } from "../dom";
import type { Alert, Parts } from "../shared/panel";
import { workspace } from "../shared/workspace";
import { Labelling } from "./labelling";

export interface ClipListListener {
  /** The clip that is open now. */
  current(): string | undefined;
  open(id: string): Promise<void>;
  delete(id: string): Promise<void>;
}

export class ClipList {
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #listener: ClipListListener;
  /** The clip that is about to be deleted. */
  #doomed: string | undefined;

  constructor(part: Parts, alert: Alert, listener: ClipListListener) {
    this.#part = part;
    this.#alert = alert;
    this.#listener = listener;
    workspace.addEventListener("clips", () => void this.update().catch(() => undefined));
  }

  async update(): Promise<void> {
    const ids = await workspace.clips();
    const rows = await Promise.all(ids.map(async (id) => this.#row(id, await Labelling.counts(id))));
    const place = this.#part("lab-clips");
    const focused = (document.activeElement as HTMLElement | null)?.dataset.part;
    const hadFocus = place.contains(document.activeElement);
    place.replaceChildren(...rows);
    if (hadFocus) place.querySelector<HTMLElement>(`[data-part="${CSS.escape(focused ?? "")}"]`)?.focus();
    this.#part("lab-no-clips").hidden = ids.length > 0;
  }

  #row(id: string, [labelled, all]: [number, number]): HTMLLIElement {
    const button = (text: string, name: string, label: string, act: () => Promise<void>) =>
      textButton(text, name, `${label} ${id}`, () => void this.#alert.during(act));
    const row = make("li", { part: `lab-clip-${id}` });
    const isOpen = this.#listener.current() === id;
    if (isOpen) row.setAttribute("aria-current", "true");
    row.append(make("span", { class: "lab-clip-name", text: id }), make("small", { text: `${labelled} of ${all} labelled${isOpen ? " · open" : ""}` }));
    const doom = (doomed: string | undefined, focus: string) => async () => {
      this.#doomed = doomed;
      await this.update();
      this.#part(`${focus}-${id}`).focus();
    };
    if (this.#doomed === id) {
      const answers = [
        button("Delete", `lab-delete-yes-${id}`, "Delete, really:", () => this.#delete(id)),
        button("Keep", `lab-delete-no-${id}`, "Keep", doom(undefined, "lab-delete")),
      ];
      row.append(make("strong", { text: "Delete it with its labels?" }), make("span", {}, ...answers));
    } else {
      if (!isOpen) row.append(button("Open", `lab-open-${id}`, "Open", () => this.#listener.open(id)));
      row.append(button("Delete…", `lab-delete-${id}`, "Delete", doom(id, "lab-delete-no")));
    }
    return row;
  }

  async #delete(id: string): Promise<void> {
    this.#doomed = undefined;
    await this.#listener.delete(id);
    await this.update();
  }
}
