/** The user's own files: a picture and its camera.json, together or one after the other, in either order. */
import type { Camera } from "gravisight";
import { element, messageOf } from "../dom";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, readJson } from "../shared/files";
import { workspace } from "../shared/workspace";
import type { Subject } from "./subject";

export interface DropListener {
  /** A picture and a camera are there. */
  onSubject(subject: Subject): void;
  /** A picture is there, its camera is not yet. */
  onPictureAlone(picture: File): void;
  onRefused(message: string): void;
}

export class Drop {
  readonly #state = element<HTMLElement>("drop-state");
  readonly #listener: DropListener;
  #picture: File | undefined;
  #camera: { name: string; content: Camera } | undefined;

  constructor(listener: DropListener) {
    this.#listener = listener;
    const take = (files: File[]) => void this.#take(files);
    listenForChosen(element<HTMLInputElement>("file-input"), take);
    listenForDropped(element("panel-try"), element("drop"), take);
  }

  /** Forgets a file that the core refused, so that it does not spoil the next one. */
  forget(what: "picture" | "camera"): void {
    if (what === "picture") this.#picture = undefined;
    else this.#camera = undefined;
    this.#showState();
  }

  async #take(files: File[]): Promise<void> {
    const cameras = files.filter(isJson);
    const pictures = files.filter((file) => !isJson(file));
    if (cameras.length > 1 || pictures.length > 1) {
      return this.#listener.onRefused("One picture and one camera.json at a time, please.");
    }
    if (pictures[0]) this.#picture = pictures[0];
    if (cameras[0]) {
      // Whatever becomes of it, the picture belongs to this camera and not to the last one.
      this.#camera = undefined;
      try {
        this.#camera = { name: cameras[0].name, content: (await readJson(cameras[0])) as Camera };
      } catch (thrown) {
        this.#showState();
        return this.#listener.onRefused(messageOf(thrown));
      }
    }
    this.#showState();
    await this.#announce();
  }

  async #announce(): Promise<void> {
    const [picture, given] = [this.#picture, this.#camera];
    if (!picture) return;
    const camera = given?.content ?? (await calibratedFor(picture));
    // Unless other files came meanwhile.
    if (picture !== this.#picture || given !== this.#camera) return;
    if (!given && camera) this.#state.textContent = `${picture.name} · with the camera ${workspace.cameraAbout?.from ?? "of the step Calibrate"}`;
    if (!camera) return this.#listener.onPictureAlone(picture);
    this.#listener.onSubject({ name: picture.name, picture, camera });
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

/** The camera of the step Calibrate, where it is for pictures of this size. */
async function calibratedFor(picture: File): Promise<Camera | undefined> {
  const { camera } = workspace;
  const bitmap = camera && (await createImageBitmap(picture).catch(() => undefined));
  const isOfSize = bitmap?.width === camera?.width && bitmap?.height === camera?.height;
  bitmap?.close();
  return isOfSize ? camera : undefined;
}
