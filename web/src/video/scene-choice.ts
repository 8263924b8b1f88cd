/** The camera and the scene in use, and where they come from: the example's own, dropped files, what was chosen, or the other steps. */
import type { Camera, Scene } from "gravisight";
import { tools } from "../shared/core";
import { readJson } from "../shared/files";
import { cameraIn, checked, type KnownCamera } from "../shared/known-camera";
import { workspace, type CameraAbout } from "../shared/workspace";
import type { Example } from "./example";

export class SceneChoice {
  /** Of the example while it is shown. */
  example: Omit<Example, "source"> | undefined;
  /** The name of the video or picture that is open; empty where none is. */
  shown = "";
  readonly #dropped: { camera?: KnownCamera; scene?: { name: string; content: Scene } } = {};
  #sport: { name: string; content: Scene } | undefined;
  /** The scene with another ball than its own. */
  #resized: Scene | undefined;

  get camera(): Camera | undefined {
    return this.example?.camera ?? this.#dropped.camera?.camera ?? (this.otherCamera ? undefined : workspace.camera);
  }

  /** How unsure the camera is, where that is known. */
  get cameraSigma(): Camera[] {
    if (this.example) return [];
    return this.#dropped.camera?.oneSigma ?? (this.otherCamera ? [] : workspace.cameraSigma);
  }

  /** What the kept camera is of, if that is another video: it is used only once a person has confirmed it. */
  get otherCamera(): CameraAbout | undefined {
    if (this.example || this.#dropped.camera || !this.shown || !workspace.camera) return undefined;
    const about = workspace.cameraAbout;
    return about && about.of.length > 0 && !about.of.includes(this.shown) ? about : undefined;
  }

  /** Whether the camera in use can be forgotten: an example's cannot. */
  get canForgetCamera(): boolean {
    return !this.example && this.camera !== undefined;
  }

  /** No longer uses the camera, in any step. */
  forgetCamera(): void {
    const wasDropped = this.#dropped.camera !== undefined;
    delete this.#dropped.camera;
    if (!wasDropped) workspace.setCamera(undefined, []);
  }

  /** Takes what a kept track was made with. */
  restore({ camera, cameraSigma, cameraFrom, cameraNote, scene, sport }: { camera?: Camera; cameraSigma: Camera[]; cameraFrom: string; cameraNote: string; scene?: Scene; sport: string }): void {
    this.example = undefined;
    this.#resized = undefined;
    delete this.#dropped.scene;
    delete this.#dropped.camera;
    if (camera) this.#dropped.camera = { name: cameraFrom, camera, oneSigma: cameraSigma, note: cameraNote };
    this.#sport = scene && sport ? { name: sport, content: scene } : undefined;
    if (scene && !sport) this.#dropped.scene = { name: "your saved work", content: scene };
  }

  /** Where the camera comes from, in words. */
  get cameraFrom(): string {
    if (this.example) return "the example’s own";
    const about = workspace.cameraAbout;
    return this.#dropped.camera?.name ?? (about ? `${about.from}, ${when(about.at)}` : "from the step Calibrate");
  }

  /** What was assumed of the camera, in words; empty where nothing was. */
  get cameraNote(): string {
    return this.example ? "" : (this.#dropped.camera?.note ?? "");
  }

  /** Takes a camera that is assumed; or drops one. */
  assume(known: KnownCamera | undefined): void {
    if (known) this.#dropped.camera = known;
    else if (this.cameraNote) delete this.#dropped.camera;
  }

  /** Undefined where no ball was chosen. */
  get scene(): Scene | undefined {
    if (this.example) return this.example.scene;
    return this.#resized ?? this.#dropped.scene?.content ?? this.#sport?.content ?? workspace.ownScene;
  }

  /** The name of the sport that was chosen; empty where none is. */
  get sport(): string {
    return this.example || this.#dropped.scene ? "" : (this.#sport?.name ?? "");
  }

  /** Takes the place of a sport; of no name, none. */
  async choose(name: string): Promise<void> {
    const content = name ? await (await tools()).scene(name) : undefined;
    this.#sport = content && { name, content };
    this.#resized = undefined;
    delete this.#dropped.scene;
    this.example = undefined;
  }

  /** Takes the sport of the camera's court if no place was chosen; true if it did. */
  async takeSport(): Promise<boolean> {
    const { court = "" } = workspace.cameraAbout ?? {};
    const sport = court && (await (await tools()).scenes()).find((name) => court.startsWith(name));
    if (!sport || this.scene || this.otherCamera) return false;
    await this.choose(sport);
    return true;
  }

  /** Another scene's ball in the same place. */
  keepBall(ball: Scene["ball"]): void {
    const { scene } = this;
    if (scene) this.#resized = { ...scene, ball };
  }

  /** Another ball in the same place; its radius in metres. */
  async setRadius(radius: number): Promise<void> {
    if (!(radius > 0 && radius < 1)) throw new Error("The ball’s diameter must be between 0 and 200 centimetres.");
    const { scene } = this;
    if (scene) this.#resized = await (await tools()).sceneWithBall(scene, { radius });
  }

  /** The other steps have another camera: it is newer than one that was dropped. */
  cameraChanged(): void {
    delete this.#dropped.camera;
  }

  /** Whose camera and scene they are. */
  get summary(): string {
    if (this.example) return this.example.summary;
    const { camera, scene } = this;
    const size = camera ? `, ${camera.width} × ${camera.height} px` : "";
    const cameraText = camera ? `Camera: ${this.cameraFrom}${size}.` : "Camera: none yet.";
    if (!scene) return `${cameraText} Place and ball: not chosen.`;
    const things = [scene.floor && "a floor", scene.boxes?.length && "boxes", scene.walls?.length && "walls"].filter(Boolean).join(", ");
    const ball = `ball ${(200 * scene.ball.radius).toFixed(1)} cm across${things ? `, ${things}` : ""}`;
    return `${cameraText} Scene${this.#dropped.scene ? ` from ${this.#dropped.scene.name}` : ""}: ${ball}.`;
  }

  /** Takes a camera.json or a scene.json, if the core has nothing against it. */
  async take(file: File): Promise<void> {
    const content = await readJson(file);
    const has = (...names: string[]) => typeof content === "object" && content !== null && names.every((name) => name in content);
    const camera = cameraIn(content);
    if (camera) this.#dropped.camera = await checked({ ...camera, name: file.name, note: "" });
    else if (has("gravity", "ball")) {
      const scene = content as Scene;
      await (await tools()).forecast(scene, { position: [0, 0, 1e3], velocity: [0, 0, 0] }, [0]);
      this.#dropped.scene = { name: file.name, content: scene };
      this.#resized = undefined;
    } else throw new Error(`${file.name} is neither a camera.json (intrinsic, camera_from_world) nor a scene.json (gravity, ball).`);
  }
}

/** A moment for people: today's by its time, others by their date. */
export function when(iso: string): string {
  const date = new Date(iso);
  const isToday = date.toDateString() === new Date().toDateString();
  return new Intl.DateTimeFormat("en-GB", isToday ? { timeStyle: "short" } : { dateStyle: "medium", timeStyle: "short" }).format(date);
}
