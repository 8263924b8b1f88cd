/** The row of sample pictures: buttons of which one is pressed; arrow keys move among them. */
import type { Camera } from "gravisight";
import { make } from "../dom";
import { fetchOk } from "../shared/files";
import { SAMPLE_BALL } from "../shared/core";
import { real, realUrl } from "../shared/real";
import type { Subject } from "./subject";

/** A rendered picture, as in `public/samples/samples.json`. */
interface Rendered {
  name: string;
  file: string;
  camera: Camera;
  world: [number, number, number];
  image: [number, number];
}

/** What a button is for. */
type Sample = Omit<Subject, "picture"> & { url: string };

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

  /** Fetches the lists and shows them: a real picture, then the rendered ones. */
  async load(): Promise<void> {
    const [{ name, picture, camera, ball, note }, rendered] = await Promise.all([
      real(),
      fetchOk(`${FOLDER}samples.json`).then((response) => response.json() as Promise<Rendered[]>),
    ]);
    this.#buttons = [
      this.#button({ name, url: realUrl(picture), camera, ball, note }, "sample-real"),
      ...rendered.map(({ name, file, camera, world, image }, index) =>
        this.#button({ name, url: FOLDER + file, camera, ball: SAMPLE_BALL, truth: { world, image } }, `sample-${index}`),
      ),
    ];
    this.#makeTabStop(this.#buttons[0]!);
    this.#row.replaceChildren(...this.#buttons);
  }

  /** Presses the one that was pressed last in this browser; else the real one, or the first rendered one. */
  press(otherwise: "real" | "rendered"): void {
    const last = this.#buttons.find(({ dataset }) => dataset.part === remembered());
    (last ?? this.#buttons[otherwise === "real" ? 0 : 1])?.click();
  }

  /** Releases the one that is pressed. */
  release(): void {
    for (const button of this.#buttons) button.setAttribute("aria-pressed", "false");
  }

  #button(sample: Sample, part: string): HTMLButtonElement {
    const image = make("img");
    image.src = sample.url;
    image.alt = "";
    image.width = image.height = 72;
    const button = make("button", { class: "sample", part }, image, make("span", { text: sample.name }));
    button.type = "button";
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      this.release();
      button.setAttribute("aria-pressed", "true");
      this.#makeTabStop(button);
      remember(part);
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

const LAST = "gravisight.try.sample";

function remembered(): string | null {
  try {
    return localStorage.getItem(LAST);
  } catch {
    return null;
  }
}

function remember(part: string): void {
  try {
    localStorage.setItem(LAST, part);
  } catch {
    // A browser that keeps nothing.
  }
}

async function subjectOf({ url, ...about }: Sample): Promise<Subject> {
  const response = await fetchOk(url);
  return { ...about, picture: await response.blob() };
}
