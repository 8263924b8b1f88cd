/** The row of sample pictures: buttons of which one is pressed; arrow keys move among them. */
import type { Camera } from "gravisight";
import { make } from "../dom";
import { fetchOk } from "../shared/files";
import { SAMPLE_BALL } from "../shared/core";
import type { Subject } from "./subject";

interface Sample {
  name: string;
  file: string;
  camera: Camera;
  world: [number, number, number];
  image: [number, number];
}

const FOLDER = `${import.meta.env.BASE_URL}samples/`;

/** The keys that move the focus, and by how much. */
const STEPS: Record<string, number> = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1, Home: -Infinity, End: Infinity };

export class Samples {
  readonly #row: HTMLElement;
  readonly #choose: (sample: Promise<Subject>) => void;
  #buttons: HTMLButtonElement[] = [];

  constructor(row: HTMLElement, choose: (sample: Promise<Subject>) => void) {
    this.#row = row;
    this.#choose = choose;
    row.addEventListener("keydown", (event) => this.#moveFocus(event));
  }

  /** Fetches the list and shows it. */
  async load(): Promise<void> {
    const response = await fetchOk(`${FOLDER}samples.json`);
    const samples = (await response.json()) as Sample[];
    this.#buttons = samples.map((sample, index) => this.#button(sample, index));
    this.#row.replaceChildren(...this.#buttons);
  }

  /** Presses one of them. */
  press(index: number): void {
    this.#buttons[index]?.click();
  }

  /** Releases the one that is pressed. */
  release(): void {
    for (const button of this.#buttons) button.setAttribute("aria-pressed", "false");
  }

  #button(sample: Sample, index: number): HTMLButtonElement {
    const image = make("img");
    image.src = FOLDER + sample.file;
    image.alt = "";
    image.width = image.height = 72;
    const button = make("button", { class: "sample", part: `sample-${index}` }, image, make("span", { text: sample.name }));
    button.type = "button";
    button.tabIndex = index === 0 ? 0 : -1;
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      this.release();
      button.setAttribute("aria-pressed", "true");
      this.#makeTabStop(button);
      this.#choose(subjectOf(sample));
    });
    return button;
  }

  #moveFocus(event: KeyboardEvent): void {
    const step = STEPS[event.key];
    const from = this.#buttons.indexOf(document.activeElement as HTMLButtonElement);
    if (step === undefined || from < 0) return;
    event.preventDefault();
    const to = this.#buttons[Math.min(Math.max(from + step, 0), this.#buttons.length - 1)];
    if (!to) return;
    this.#makeTabStop(to);
    to.focus();
  }

  #makeTabStop(button: HTMLButtonElement): void {
    for (const other of this.#buttons) other.tabIndex = other === button ? 0 : -1;
  }
}

async function subjectOf(sample: Sample): Promise<Subject> {
  const response = await fetchOk(FOLDER + sample.file);
  const { name, camera, world, image } = sample;
  return { name, picture: await response.blob(), camera, ball: SAMPLE_BALL, truth: { world, image } };
}
