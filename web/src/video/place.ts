/** The camera and the scene in use, and where they come from: the example's own, dropped files, or the other steps. */
import type { Camera, Scene } from "gravisight";
import { wordsOf } from "../dom";
import { workspace } from "../shared/workspace";

export class Place {
  /** Of the example while it is shown. */
  example: { camera: Camera; scene: Scene } | undefined;
  #dropped: { camera?: { name: string; content: Camera }; scene?: { name: string; content: Scene } } = {};

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

  /** Takes a camera.json or a scene.json; the core checks what is in it. */
  async take(file: File): Promise<"camera" | "scene"> {
    let content: unknown;
    try {
      content = JSON.parse(await file.text());
    } catch (thrown) {
      throw new Error(`${file.name} is not JSON: ${wordsOf(thrown)}.`);
    }
    if (typeof content === "object" && content !== null) {
      if ("intrinsic" in content && "camera_from_world" in content) {
        this.#dropped.camera = { name: file.name, content: content as Camera };
        return "camera";
      }
      if ("gravity" in content && "ball" in content) {
        this.#dropped.scene = { name: file.name, content: content as Scene };
        return "scene";
      }
    }
    throw new Error(`${file.name} is neither a camera.json (intrinsic, camera_from_world) nor a scene.json (gravity, ball).`);
  }

  /** Forgets a file that the core refused. */
  forget(what: "camera" | "scene"): void {
    delete this.#dropped[what];
  }
}
