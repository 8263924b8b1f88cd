/** The user's own files: a picture and its camera.json, together or one after the other, in either order; or a camera that is assumed. */
import { element, messageOf } from "../dom";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, otherToolsCamera, readablePicture } from "../shared/files";
import { assumedPhone, knownCameraFrom, type KnownCamera } from "../shared/known-camera";
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
  readonly #assumeButton = element<HTMLButtonElement>("assume-phone");
  readonly #listener: DropListener;
  #picture: File | undefined;
  #camera: KnownCamera | undefined;
  /** Whether pictures without a camera are a phone's. */
  #assumes = false;

  constructor(listener: DropListener) {
    this.#listener = listener;
    const take = (files: File[]) => void this.#take(files);
    listenForChosen(element<HTMLInputElement>("file-input"), take);
    listenForDropped(element("panel-try"), element("drop"), take);
    this.#assumeButton.addEventListener("click", () => this.#assume(!this.#assumes));
  }

  /** Forgets a file that the core refused, so that it does not spoil the next one. */
  forget(what: "picture" | "camera"): void {
    if (what === "picture") this.#picture = undefined;
    else this.#camera = undefined;
    this.#showState();
  }

  #assume(assumes: boolean): void {
    this.#assumes = assumes;
    this.#camera = undefined;
    this.#showState();
    void this.#announce();
  }

  async #take(files: File[]): Promise<void> {
    const refusal = otherToolsCamera(files);
    if (refusal) return this.#listener.onRefused(refusal);
    const cameras = files.filter(isJson);
    const pictures = files.filter((file) => !isJson(file));
    if (cameras.length > 1 || pictures.length > 1) {
      return this.#listener.onRefused("One picture and one camera.json at a time, please.");
    }
    if (pictures[0]) this.#picture = pictures[0];
    if (cameras[0]) {
      // Whatever becomes of it, the picture belongs to this camera and not to the last one.
      this.#camera = undefined;
      this.#assumes = false;
      try {
        this.#camera = await knownCameraFrom(cameras[0]);
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
    const known = this.#assumes ? await this.#phone(picture) : (given ?? (await calibratedFor(picture)));
    // Unless other files came meanwhile.
    if (picture !== this.#picture || given !== this.#camera) return;
    if (!known) return this.#listener.onPictureAlone(picture);
    const { camera, oneSigma, note, name } = known;
    if (!given && !this.#assumes) this.#state.textContent = `${picture.name} · with the camera ${name}`;
    this.#listener.onSubject({ name: picture.name, picture: await readablePicture(picture), camera, oneSigma, ...(note && { note }) });
  }

  /** The camera to assume for a picture; none for a file that is no picture. */
  async #phone(picture: File): Promise<KnownCamera | undefined> {
    const bitmap = await createImageBitmap(picture).catch(() => undefined);
    if (!bitmap) return undefined;
    const { width, height } = bitmap;
    bitmap.close();
    return assumedPhone({ width, height }, picture, false);
  }

  #showState(): void {
    const parts = [];
    if (this.#picture) parts.push(this.#picture.name);
    if (this.#camera) parts.push(`${this.#camera.name} (kept for the next picture)`);
    if (this.#assumes) parts.push("camera: a phone, held level (kept for the next picture)");
    const hasCamera = this.#camera !== undefined || this.#assumes;
    if (hasCamera && !this.#picture) parts.push("now add a picture");
    if (this.#picture && !hasCamera) parts.push("now add its camera.json, or assume a phone");
    this.#state.textContent = parts.join(" · ") || "or choose the two files";
    this.#assumeButton.setAttribute("aria-pressed", String(this.#assumes));
  }
}

/** The camera of the step Calibrate, where it is for pictures of this size. */
async function calibratedFor(picture: File): Promise<KnownCamera | undefined> {
  const { camera, cameraSigma, cameraAbout } = workspace;
  const bitmap = camera && (await createImageBitmap(picture).catch(() => undefined));
  const isOfSize = bitmap?.width === camera?.width && bitmap?.height === camera?.height;
  bitmap?.close();
  return camera && isOfSize ? { name: cameraAbout?.from ?? "from the step Calibrate", camera, oneSigma: cameraSigma, note: "" } : undefined;
}
