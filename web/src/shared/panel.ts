/** What the steps' panels are made of. */
import { make, messageOf } from "../dom";
import { markupOf } from "./trusted";

/** Finds a part of a step by its `data-part`. */
export type Parts = <T extends HTMLElement = HTMLElement>(name: string) => T;

/** Fills `panel` with the markup of a step and returns a finder of its parts by `data-part`. */
export function fill(panel: HTMLElement, markup: string): Parts {
  const template = document.createElement("template");
  template.innerHTML = markupOf(markup);
  panel.replaceChildren(template.content);
  return <T extends HTMLElement>(name: string): T => {
    const found = panel.querySelector<T>(`[data-part="${name}"]`);
    if (!found) throw new Error(`the panel has no ${name}`);
    return found;
  };
}

/** A place for errors: shown and read out until the next success. */
export class Alert {
  readonly #place: HTMLElement;

  constructor(place: HTMLElement) {
    this.#place = place;
    place.classList.add("alert");
    place.setAttribute("role", "alert");
  }

  say(text: string): void {
    this.#place.replaceChildren(make("span", { text }));
  }

  clear(): void {
    this.#place.replaceChildren();
  }

  /** Runs `work`; what it throws is shown, an abort is not. */
  async during(work: () => Promise<void>): Promise<void> {
    this.clear();
    try {
      await work();
    } catch (thrown) {
      if (!(thrown instanceof DOMException && thrown.name === "AbortError")) this.say(messageOf(thrown));
    }
  }
}
