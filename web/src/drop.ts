/** The user's own files: a picture and its camera.json, together or one after the other, in either order. */
import type { Camera } from "gravisight";
import { element, wordsOf } from "./dom";
import type { Subject } from "./subject";

export interface DropListener {
  /** A picture and a camera are there. */
  onSubject(subject: Subject): void;
  /** A picture is there, its camera is not yet. */
  onPictureAlone(picture: File): void;
  onRefused(message: string): void;
}

export class Drop {
  readonly #zone = element<HTMLLabelElement>("drop");
  readonly #state = element<HTMLElement>("drop-state");
  readonly #listener: DropListener;
  #picture: File | undefined;
  #camera: { name: string; content: Camera } | undefined;

  constructor(listener: DropListener) {
    this.#listener = listener;
    const input = element<HTMLInputElement>("file-input");
    input.addEventListener("change", () => {
      void this.#take([...(input.files ?? [])]);
      // So that choosing the same file again is a change.
      input.value = "";
    });
    this.#listenForDrops();
  }

  /** Forgets a file that the core refused, so that it does not spoil the next one. */
  forget(what: "picture" | "camera"): void {
    if (what === "picture") this.#picture = undefined;
    else this.#camera = undefined;
    this.#showState();
  }

  /** The whole page takes drops: a file that misses the zone must not replace the page. */
  #listenForDrops(): void {
    document.addEventListener("dragover", (event) => {
      event.preventDefault();
      this.#zone.classList.add("over");
    });
    document.addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) this.#zone.classList.remove("over");
    });
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      this.#zone.classList.remove("over");
      void this.#take([...(event.dataTransfer?.files ?? [])]);
    });
  }

  async #take(files: File[]): Promise<void> {
    const cameras = files.filter(isJson);
    const pictures = files.filter((file) => !isJson(file));
    if (files.length === 0) return;
    if (cameras.length > 1 || pictures.length > 1) {
      return this.#listener.onRefused("One picture and one camera.json at a time, please.");
    }
    if (pictures[0]) this.#picture = pictures[0];
    if (cameras[0]) {
      // Whatever becomes of it, the picture belongs to this camera and not to the last one.
      this.#camera = undefined;
      try {
        this.#camera = { name: cameras[0].name, content: await cameraFrom(cameras[0]) };
      } catch (thrown) {
        this.#showState();
        return this.#listener.onRefused(wordsOf(thrown));
      }
    }
    this.#showState();
    this.#announce();
  }

  #announce(): void {
    if (!this.#picture) return;
    if (!this.#camera) return this.#listener.onPictureAlone(this.#picture);
    this.#listener.onSubject({ name: this.#picture.name, picture: this.#picture, camera: this.#camera.content });
  }

  #showState(): void {
    const parts = [];
    if (this.#picture) parts.push(this.#picture.name);
    if (this.#camera) parts.push(`${this.#camera.name} (kept for the next picture)`);
    if (this.#camera && !this.#picture) parts.push("now add a picture");
    if (this.#picture && !this.#camera) parts.push("now add its camera.json");
    this.#state.textContent = parts.join(" · ") || "or choose the two files";
  }
}

function isJson(file: File): boolean {
  return file.type === "application/json" || file.name.toLowerCase().endsWith(".json");
}

/** Reads a camera.json; the core checks what is in it. */
async function cameraFrom(file: File): Promise<Camera> {
  let text: string;
  try {
    text = await file.text();
  } catch (thrown) {
    throw new Error(`${file.name} could not be read: ${wordsOf(thrown)}.`);
  }
  try {
    return JSON.parse(text) as Camera;
  } catch (thrown) {
    const hint = /\b(NaN|Infinity)\b/.test(text) ? " NaN and infinity are not numbers in JSON, and no camera has them." : "";
    throw new Error(`${file.name} is not JSON: ${wordsOf(thrown)}.${hint}`);
  }
}
