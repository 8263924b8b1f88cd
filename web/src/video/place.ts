/** The camera and the scene in use, and where they come from: the example's own, dropped files, or the other steps. */
import type { Camera, Scene } from "gravisight";
import { tools } from "../shared/core";
import { readJson } from "../shared/files";
import { workspace } from "../shared/workspace";

export class Place {
  /** Of the example while it is shown. */
  example: { camera: Camera; scene: Scene } | undefined;
  readonly #dropped: { camera?: { name: string; content: Camera }; scene?: { name: string; content: Scene } } = {};

  get camera(): Camera | undefined {
    return this.example?.camera ?? this.#dropped.camera?.content ?? workspace.camera;
  }

  get scene(): Scene {
    return this.example?.scene ?? this.#dropped.scene?.content ?? workspace.scene;
  }

  /** Whose camera and scene they are, in words. */
  get words(): string {
    if (this.example) return "Camera and scene: the example’s own.";
    const { camera, scene } = this;
    const size = camera ? `, ${camera.width} × ${camera.height} px` : "";
    const from = this.#dropped.camera?.name ?? "the step Calibrate";
    const things = [scene.floor && "a floor", scene.boxes?.length && "boxes", scene.walls?.length && "walls"].filter(Boolean).join(", ");
    const ball = `ball of ${(200 * scene.ball.radius).toFixed(1)} cm across${things ? `, ${things}` : ""}`;
    return `${camera ? `Camera: from ${from}${size}.` : "Camera: none yet."} Scene${this.#dropped.scene ? ` from ${this.#dropped.scene.name}` : ""}: ${ball}.`;
  }

  /** Takes a camera.json or a scene.json, if the core has nothing against it. */
  async take(file: File): Promise<void> {
    const content = await readJson(file);
    const has = (...names: string[]) => typeof content === "object" && content !== null && names.every((name) => name in content);
    if (has("intrinsic", "camera_from_world")) {
      const camera = content as Camera;
      await (await tools()).project(camera, [[0, 0, 0]]);
      this.#dropped.camera = { name: file.name, content: camera };
    } else if (has("gravity", "ball")) {
      const scene = content as Scene;
      await (await tools()).forecast(scene, { position: [0, 0, 1e3], velocity: [0, 0, 0] }, [0]);
      this.#dropped.scene = { name: file.name, content: scene };
    } else throw new Error(`${file.name} is neither a camera.json (intrinsic, camera_from_world) nor a scene.json (gravity, ball).`);
  }
}
