/** A scene in space, to be turned: the floor, boxes and walls, the camera, the ball's paths. World: z up, metres. */
import type { Camera, Scene, Vector } from "gravisight";
import {
  Box3,
  Color,
  DirectionalLight,
  HemisphereLight,
  MathUtils,
  Object3D,
  PerspectiveCamera,
  Scene as Stage,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { make } from "../dom";
import { ballOf, dotsOf, free, frustumOf, marksOf, placeOf, poseOf, tubeOf, UP } from "./view3d-objects";

/** Whose path, whose ball. */
export type PathName = "truth" | "found" | "fit";

const COLOURS: Record<PathName, string> = { truth: "--good", found: "--found", fit: "--accent" };
/** Radius of a path's tube, of the ball's radius. */
const TUBE = { truth: 0.14, fit: 0.24 };
/** Of a position that was found, in CSS pixels. */
const DOT = 3;
/** Radians that an arrow key rotates the view by. */
const ROTATION_STEP = MathUtils.degToRad(6);
const ZOOM = 1.15;
/** Radians from straight above and from the horizon below which the view does not go. */
const POLE = MathUtils.degToRad(3);
/** Part of the view, from its middle to its edge, that is filled at first. */
const FILLED = 0.88;
/** Milliseconds between two drawings, and drawn for displayed pixels, where there is no GPU: so that the page still answers. */
const WITHOUT_GPU = { pause: 150, ratio: 0.6 };
const NO_WEBGL = "This browser does not support 3D graphics (WebGL), so the view in space is left out; the numbers and plots are complete without it.";

export class View3d {
  readonly #canvas: HTMLCanvasElement;
  readonly #renderer: WebGLRenderer | undefined;
  readonly #stage = new Stage();
  readonly #eye = new PerspectiveCamera(45, 1, 0.01, 500);
  readonly #controls: OrbitControls | undefined;
  /** What is drawn, by name: redrawn when the colours change. */
  readonly #drawn = new Map<string, { draw: () => Object3D | null; object: Object3D | null }>();
  /** Given back after what replaces them was drawn: it uses their shaders, which take long to compile. */
  readonly #replaced: Object3D[] = [];
  #scene: Scene | undefined;
  #camera: Camera | undefined;
  #paths: Partial<Record<PathName, Vector[]>> = {};
  /** What the view was last placed for, and some room. */
  #placed = new Box3();
  /** Whether a person has rotated the view: then it stays. */
  #rotated = false;
  #requested = false;
  /** Whether something was added since the last drawing. */
  #hasNew = false;
  readonly #hasGpu: boolean;

  constructor(canvas: HTMLCanvasElement) {
    this.#canvas = canvas;
    const fast = canvas.getContext("webgl2", { antialias: true, alpha: true, failIfMajorPerformanceCaveat: true });
    const context = fast ?? canvas.getContext("webgl2", { antialias: false, alpha: true });
    this.#hasGpu = fast !== null;
    if (!context) {
      canvas.hidden = true;
      canvas.after(make("p", { class: "hint no-webgl", text: NO_WEBGL, part: "no-webgl" }));
      return;
    }
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    this.#renderer = new WebGLRenderer({ canvas, context });
    this.#renderer.setClearAlpha(0);
    this.#eye.up.copy(UP);
    this.#eye.position.set(6, -6, 4);
    const light = new DirectionalLight(0xffffff, 1.6);
    light.position.set(3, -4, 8);
    const sky = new HemisphereLight(0xffffff, 0x8890a8, 1.6);
    sky.position.copy(UP);
    this.#stage.add(sky, light);
    this.#listen();
    this.#controls = new OrbitControls(this.#eye, canvas);
    this.#controls.addEventListener("start", () => (this.#rotated = true));
    this.#controls.addEventListener("change", () => this.#request());
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#describe();
  }

  /** Shows a place, and the camera in it; paths and balls are forgotten. */
  setScene(scene: Scene, camera?: Camera): void {
    this.#scene = scene;
    this.#camera = camera;
    this.#paths = {};
    this.#rotated = false;
    for (const name of [...this.#drawn.keys()]) this.#put(name, () => null);
    this.#place();
  }

  setPath(name: PathName, points: Vector[]): void {
    this.#paths[name] = points;
    this.#put(`path ${name}`, () => {
      if (points.length < 2) return null;
      const colour = this.#colour(COLOURS[name]);
      return name === "found" ? dotsOf(points, colour, DOT * (this.#renderer?.getPixelRatio() ?? 1)) : tubeOf(points, colour, this.#radius() * TUBE[name]);
    });
    if (!this.#rotated && !this.#placed.containsBox(this.#content())) this.#place();
    this.#describe();
  }

  setBall(name: PathName, point: Vector | null): void {
    this.#put(`ball ${name}`, () => point && ballOf(point, this.#colour(COLOURS[name]), this.#radius()));
  }

  /** Marks places, such as bounces. */
  setMarks(points: Vector[]): void {
    this.#put("marks", () => marksOf(points, this.#colour("--busy"), this.#radius() * 0.7));
  }

  #listen(): void {
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.#redraw());
    this.#canvas.addEventListener("webglcontextrestored", () => this.#request());
    this.#canvas.addEventListener("keydown", (event) => this.#onKey(event));
    // The wheel scrolls the page until the view is chosen. Ahead of the controls' own listener.
    const unlessChosen = (event: Event) => {
      if (document.activeElement !== this.#canvas) event.stopImmediatePropagation();
    };
    this.#canvas.addEventListener("wheel", unlessChosen, { capture: true, passive: true });
    this.#canvas.addEventListener("pointerdown", () => this.#canvas.focus({ preventScroll: true }));
  }

  #onKey(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const steps: Record<string, () => void> = {
      ArrowLeft: () => this.#rotate(-ROTATION_STEP, 0),
      ArrowRight: () => this.#rotate(ROTATION_STEP, 0),
      ArrowUp: () => this.#rotate(0, -ROTATION_STEP),
      ArrowDown: () => this.#rotate(0, ROTATION_STEP),
      "+": () => this.#zoom(1 / ZOOM),
      "=": () => this.#zoom(1 / ZOOM),
      "-": () => this.#zoom(ZOOM),
      Home: () => this.#place(),
    };
    const step = steps[event.key];
    if (!step) return;
    event.preventDefault();
    this.#rotated = event.key !== "Home";
    step();
  }

  #rotate(around: number, down: number): void {
    const controls = this.#controls;
    if (!controls) return;
    const offset = this.#eye.position.clone().sub(controls.target);
    offset.applyAxisAngle(UP, around);
    const polar = offset.angleTo(UP);
    const targetPolar = MathUtils.clamp(polar + down, POLE, MathUtils.degToRad(180) - POLE);
    offset.applyAxisAngle(UP.clone().cross(offset).normalize(), targetPolar - polar);
    this.#eye.position.copy(controls.target).add(offset);
    controls.update();
    this.#request();
  }

  #zoom(by: number): void {
    const controls = this.#controls;
    if (!controls) return;
    this.#eye.position.sub(controls.target).multiplyScalar(by).add(controls.target);
    controls.update();
    this.#request();
  }

  /** Draws the place anew around what is in it, and stands the eye so that all of it is seen. */
  #place(): void {
    const controls = this.#controls;
    if (!controls) return;
    const content = this.#content();
    this.#placed = content.clone().expandByScalar(0.5);
    const centre = content.getCenter(new Vector3());
    const span = Math.max(2, Math.ceil(Math.max(...content.getSize(new Vector3()).toArray().slice(0, 2))) + 2);
    this.#put("place", () => (this.#scene ? placeOf(this.#scene, centre, span, (name) => this.#colour(name)) : null));
    this.#put("camera", () => (this.#camera ? frustumOf(this.#camera, span / 9, this.#colour("--ink")) : null));
    this.#describe();
    if (this.#rotated) return;
    const size = content.getSize(new Vector3()).length() || 4;
    // From the camera's own side, a little off and above, so that left and right are as in the picture.
    const from = this.#camera ? poseOf(this.#camera).position.sub(centre).setZ(0) : new Vector3(1, -1, 0);
    if (from.length() < 1e-3) from.set(1, -1, 0);
    from.normalize().applyAxisAngle(UP, MathUtils.degToRad(38)).setZ(0.55).normalize();
    controls.target.copy(centre);
    let distance = size;
    // Nearer or farther until the outermost corner is where it should be; nearness changes the perspective, so again.
    for (let times = 0; times < 6; times++) {
      this.#eye.position.copy(centre).addScaledVector(from, distance);
      controls.update();
      this.#eye.updateMatrixWorld();
      distance *= Math.max(0.4, outermost(content, this.#eye) / FILLED);
    }
    this.#request();
  }

  /** What must be in view. */
  #content(): Box3 {
    const box = new Box3();
    const point = (vector: Vector) => box.expandByPoint(new Vector3(...vector));
    for (const { position, half_size } of this.#scene?.boxes ?? []) {
      const half = new Vector3(...half_size);
      box.union(new Box3(new Vector3(...position).sub(half), new Vector3(...position).add(half)));
    }
    if (this.#camera) {
      const pose = poseOf(this.#camera);
      box.expandByPoint(pose.position);
      if (Object.values(this.#paths).every((path) => path.length === 0)) box.expandByPoint(pose.ahead);
    }
    for (const path of Object.values(this.#paths)) path.forEach(point);
    if (box.isEmpty()) box.set(new Vector3(-2, -2, 0), new Vector3(2, 2, 2));
    const floor = this.#scene?.floor?.height;
    if (floor !== undefined) box.expandByPoint(box.getCenter(new Vector3()).setZ(floor));
    return box;
  }

  #radius(): number {
    return this.#scene?.ball.radius ?? 0.1;
  }

  #colour(name: string): Color {
    return new Color(getComputedStyle(this.#canvas).getPropertyValue(name).trim() || "#888888");
  }

  #put(name: string, draw: () => Object3D | null): void {
    if (!this.#renderer) return;
    const old = this.#drawn.get(name)?.object ?? null;
    old?.removeFromParent();
    if (old) this.#replaced.push(old);
    const object = draw();
    if (object) this.#stage.add(object);
    this.#hasNew = true;
    this.#drawn.set(name, { draw, object });
    this.#request();
  }

  /** In the colours of now. */
  #redraw(): void {
    for (const [name, { draw }] of [...this.#drawn]) this.#put(name, draw);
  }

  #describe(): void {
    if (!this.#renderer) return;
    const labels: Record<PathName, string> = { truth: "true path", found: "positions frame by frame", fit: "fitted path" };
    const shown = (Object.keys(labels) as PathName[]).filter((name) => (this.#paths[name]?.length ?? 0) > 1).map((name) => labels[name]);
    const content = shown.length ? `the ball’s ${shown.join(", ")}` : "no path yet";
    this.#canvas.setAttribute("aria-label", `3D view: ${content}. Arrow keys turn it, plus and minus zoom, Home resets.`);
  }

  #resize(): void {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    // A hidden step has no size; it is drawn when it is shown.
    if (!width || !height) return;
    this.#renderer?.setPixelRatio(this.#hasGpu ? Math.min(2, window.devicePixelRatio || 1) : WITHOUT_GPU.ratio);
    this.#renderer?.setSize(width, height, false);
    this.#eye.aspect = width / height;
    // What fits into a wide view fits into a narrow one, too.
    this.#eye.fov = width < height * 1.2 ? 58 : 45;
    this.#eye.updateProjectionMatrix();
    if (this.#scene && !this.#rotated) this.#place();
    this.#request();
  }

  #request(): void {
    if (!this.#renderer || this.#requested) return;
    this.#requested = true;
    const soon = () => requestAnimationFrame(() => void this.#render());
    if (this.#hasGpu) soon();
    else setTimeout(soon, WITHOUT_GPU.pause);
  }

  async #render(): Promise<void> {
    // What is new has shaders to be compiled: to wait for them in `render` would stop the page.
    if (this.#hasNew) await this.#renderer?.compileAsync(this.#stage, this.#eye);
    this.#hasNew = false;
    this.#requested = false;
    this.#renderer?.render(this.#stage, this.#eye);
    this.#replaced.splice(0).forEach(free);
  }
}

/** How far from the middle of the view (1: the edge) the farthest corner of a box is. */
function outermost({ min, max }: Box3, eye: PerspectiveCamera): number {
  const corners = [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new Vector3(x, y, z).project(eye))));
  return Math.max(...corners.flatMap(({ x, y }) => [Math.abs(x), Math.abs(y)]));
}
