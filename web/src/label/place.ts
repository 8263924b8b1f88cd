/** Where the open clip was filmed: its camera, its place and its ball, to choose and to change. */
import type { Camera } from "gravisight";
import { sizeOf } from "../shared/clip";
import { tools } from "../shared/core";
import type { Alert, Parts } from "../shared/panel";
import { SPORTS } from "../shared/sports";
import { workspace, type StoredClip } from "../shared/workspace";
import type { Labelling } from "./labelling";

/** Radius, m. */
const LARGEST = 1;

export class Place {
  readonly #part: Parts;
  readonly #current: () => Labelling | undefined;
  readonly #changed: (text: string) => void;
  /** The clip for which a camera is being calibrated. */
  #waiting: string | undefined;

  /** `changed` hears what has been set. */
  constructor(part: Parts, alert: Alert, current: () => Labelling | undefined, changed: (text: string) => void) {
    this.#part = part;
    this.#current = current;
    this.#changed = changed;
    const sport = part<HTMLSelectElement>("lab-sport");
    for (const [name, label] of SPORTS) sport.append(new Option(label, name));
    sport.addEventListener("change", () => void alert.during(() => this.#choose(sport.value)));
    const ball = part<HTMLInputElement>("lab-ball");
    ball.addEventListener("change", () => void alert.during(() => this.#setBall(ball.valueAsNumber / 200)));
    part("lab-recamera").addEventListener("click", () => this.#takeCamera());
    part("lab-calibrate").addEventListener("click", () => this.#calibrate());
  }

  show(): void {
    const clip = this.#current()?.clip;
    if (!clip) return;
    const { scene, camera, truth } = clip;
    this.#part<HTMLSelectElement>("lab-sport").value = scene ? (clip.sport ?? "other") : "";
    // A scene that came from elsewhere can be kept, not chosen.
    this.#part("lab-sport-other").hidden = !scene || clip.sport !== undefined;
    this.#part<HTMLSelectElement>("lab-sport").disabled = truth !== undefined;
    const ball = this.#part<HTMLInputElement>("lab-ball");
    ball.disabled = !scene || truth !== undefined;
    ball.value = scene ? String(Number((200 * scene.ball.radius).toFixed(2))) : "";
    this.#part("lab-clip-camera").textContent = camera
      ? `Camera: for frames of ${camera.width}\u00a0×\u00a0${camera.height} pixels.`
      : "No camera yet. Labels and the track (CSV) do not need one; metres, flights and fine-tuning do.";
    const own = workspace.camera;
    this.#part("lab-recamera").hidden = !own || !isFor(clip, own) || truth !== undefined || JSON.stringify(own) === JSON.stringify(camera);
    this.#part("lab-calibrate").hidden = camera !== undefined;
  }

  async #choose(name: string): Promise<void> {
    const labelling = this.#current();
    if (!labelling || name === "other") return;
    const scene = name ? await (await tools()).scene(name) : undefined;
    labelling.setScene(scene, scene && name);
    this.#changed(scene ? `The clip’s ball is ${(200 * scene.ball.radius).toFixed(1)} cm across.` : "");
  }

  async #setBall(radius: number): Promise<void> {
    const labelling = this.#current();
    const { scene, sport } = labelling?.clip ?? {};
    if (!labelling || !scene) return;
    if (!(radius > 0 && radius < LARGEST)) {
      this.show();
      throw new Error("The ball’s diameter must be between 0 and 200 centimetres.");
    }
    labelling.setScene(await (await tools()).sceneWithBall(scene, { radius }), sport);
    this.#changed(`The clip’s ball is ${(200 * radius).toFixed(1)} cm across.`);
  }

  /** There is another camera: the clip that waits for one takes it. */
  cameraChanged(): void {
    const clip = this.#current()?.clip;
    const { camera } = workspace;
    if (!camera || !clip || clip.camera || clip.id !== this.#waiting) return this.show();
    this.#waiting = undefined;
    if (isFor(clip, camera)) this.#takeCamera();
    this.show();
  }

  #takeCamera(): void {
    const { camera } = workspace;
    const labelling = this.#current();
    if (!camera || !labelling) return;
    labelling.setCamera(camera);
    if (labelling.clip.file) workspace.cameraIsOf(labelling.clip.file);
    this.#changed("The clip now uses the calibrated camera.");
  }

  #calibrate(): void {
    const labelling = this.#current();
    const picture = labelling?.clip.pictures[labelling.frame];
    if (!labelling || !picture) return;
    const { id, file = id, sport = "" } = labelling.clip;
    this.#waiting = id;
    workspace.calibrate({ picture, name: `frame ${labelling.frame + 1} of ${id}`, of: file, sport, back: "label" });
  }
}

function isFor(clip: StoredClip, { width, height }: Camera): boolean {
  const size = sizeOf(clip);
  return size?.width === width && size.height === height;
}
