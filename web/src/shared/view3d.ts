/** A scene in space, to be turned: the floor, boxes and walls, the camera, the ball's paths. World: z up, metres. */
import type { Camera, Scene, Vector } from "gravisight";
import {
  Box3,
  BoxGeometry,
  BufferGeometry,
  CatmullRomCurve3,
  Color,
  DirectionalLight,
  DoubleSide,
  EdgesGeometry,
  GridHelper,
  Group,
  HemisphereLight,
  Line,
  LineBasicMaterial,
  LineSegments,
  MathUtils,
  Matrix3,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Object3D,
  OctahedronGeometry,
  PerspectiveCamera,
  Plane,
  PlaneGeometry,
  Points,
  PointsMaterial,
  Scene as Stage,
  SphereGeometry,
  TubeGeometry,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { make } from "../dom";

/** Whose path, whose ball. */
export type PathName = "truth" | "found" | "fit";

const COLOURS: Record<PathName, string> = { truth: "--good", found: "--found", fit: "--accent" };
/** Radius of a path's tube, of the ball's radius. */
const TUBE = { truth: 0.14, fit: 0.24 };
/** Of a position that was found, in CSS pixels. */
const DOT = 3;
const UP = new Vector3(0, 0, 1);
/** Radians that an arrow key turns the view by. */
const TURN = MathUtils.degToRad(6);
const ZOOM = 1.15;
/** Radians from straight above and from the horizon below which the view does not go. */
const POLE = MathUtils.degToRad(3);
/** Part of the view, from its middle to its edge, that is filled at first. */
const FILLED = 0.88;
const NO_WEBGL = "This browser shows no 3D graphics (WebGL), so the view in space is left out; the numbers and plots are complete without it.";

export class View3d {
  readonly #canvas: HTMLCanvasElement;
  readonly #renderer: WebGLRenderer | undefined;
  readonly #stage = new Stage();
  readonly #eye = new PerspectiveCamera(45, 1, 0.01, 500);
  readonly #controls: OrbitControls | undefined;
  /** What is drawn, by name: redrawn when the colours change. */
  readonly #drawn = new Map<string, { draw: () => Object3D | null; object: Object3D | null }>();
  readonly #listening = new AbortController();
  readonly #observer: ResizeObserver | undefined;
  readonly #words: HTMLElement | undefined;
  #scene: Scene | undefined;
  #camera: Camera | undefined;
  #paths: Partial<Record<PathName, Vector[]>> = {};
  /** What the view was last placed for, and some room. */
  #placed = new Box3();
  /** Whether a person has turned the view: then it stays. */
  #turned = false;
  #requested = 0;

  constructor(canvas: HTMLCanvasElement) {
    this.#canvas = canvas;
    const context = canvas.getContext("webgl2", { antialias: true, alpha: true });
    if (!context) {
      this.#words = make("p", { class: "hint no-webgl", text: NO_WEBGL, testId: "no-webgl" });
      canvas.hidden = true;
      canvas.after(this.#words);
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
    this.#controls.addEventListener("start", () => (this.#turned = true));
    this.#controls.addEventListener("change", () => this.#request());
    this.#observer = new ResizeObserver(() => this.#resize());
    this.#observer.observe(canvas);
    this.#describe();
  }

  /** Shows a place, and the camera in it; paths and balls are forgotten. */
  setScene(scene: Scene, camera?: Camera): void {
    this.#scene = scene;
    this.#camera = camera;
    this.#paths = {};
    this.#turned = false;
    for (const name of [...this.#drawn.keys()]) this.#put(name, () => null);
    this.#place();
  }

  setPath(name: PathName, points: Vector[]): void {
    this.#paths[name] = points;
    this.#put(`path ${name}`, () => (points.length < 2 ? null : this.#path(name, points)));
    if (!this.#turned && !this.#placed.containsBox(this.#content())) this.#place();
    this.#describe();
  }

  setBall(name: PathName, point: Vector | null): void {
    this.#put(`ball ${name}`, () => {
      if (!point) return null;
      const ball = new Mesh(new SphereGeometry(this.#radius(), 24, 16), new MeshLambertMaterial({ color: this.#colour(COLOURS[name]) }));
      ball.position.fromArray(point);
      return ball;
    });
  }

  /** Marks places, such as bounces. */
  setMarks(points: Vector[]): void {
    this.#put("marks", () => {
      const marks = new Group();
      const size = this.#radius() * 0.7;
      for (const point of points) {
        // Through whatever stands before it: a mark is a note, not a thing.
        const material = new MeshBasicMaterial({ color: this.#colour("--busy"), depthTest: false, transparent: true, opacity: 0.9 });
        const mark = new Mesh(new OctahedronGeometry(size), material);
        mark.position.fromArray(point);
        marks.add(mark);
      }
      return marks;
    });
  }

  dispose(): void {
    this.#listening.abort();
    cancelAnimationFrame(this.#requested);
    for (const { object } of this.#drawn.values()) free(object);
    this.#drawn.clear();
    this.#observer?.disconnect();
    this.#controls?.dispose();
    this.#renderer?.dispose();
    this.#words?.remove();
  }

  #listen(): void {
    const { signal } = this.#listening;
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.#redraw(), { signal });
    this.#canvas.addEventListener("webglcontextrestored", () => this.#request(), { signal });
    this.#canvas.addEventListener("keydown", (event) => this.#onKey(event), { signal });
    // The wheel scrolls the page until the view is chosen. Ahead of the controls' own listener.
    const unlessChosen = (event: Event) => {
      if (document.activeElement !== this.#canvas) event.stopImmediatePropagation();
    };
    this.#canvas.addEventListener("wheel", unlessChosen, { signal, capture: true, passive: true });
    this.#canvas.addEventListener("pointerdown", () => this.#canvas.focus({ preventScroll: true }), { signal });
  }

  #onKey(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const steps: Record<string, () => void> = {
      ArrowLeft: () => this.#turn(-TURN, 0),
      ArrowRight: () => this.#turn(TURN, 0),
      ArrowUp: () => this.#turn(0, -TURN),
      ArrowDown: () => this.#turn(0, TURN),
      "+": () => this.#zoom(1 / ZOOM),
      "=": () => this.#zoom(1 / ZOOM),
      "-": () => this.#zoom(ZOOM),
      Home: () => this.#place(),
    };
    const step = steps[event.key];
    if (!step) return;
    event.preventDefault();
    this.#turned = event.key !== "Home";
    step();
  }

  #turn(around: number, down: number): void {
    const controls = this.#controls;
    if (!controls) return;
    const offset = this.#eye.position.clone().sub(controls.target);
    offset.applyAxisAngle(UP, around);
    const polar = offset.angleTo(UP);
    const wanted = MathUtils.clamp(polar + down, POLE, MathUtils.degToRad(180) - POLE);
    offset.applyAxisAngle(UP.clone().cross(offset).normalize(), wanted - polar);
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
    this.#put("place", () => this.#drawPlace(centre, span));
    this.#put("camera", () => (this.#camera ? this.#frustum(this.#camera, span / 9) : null));
    this.#describe();
    if (this.#turned) return;
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

  #drawPlace(centre: Vector3, span: number): Object3D {
    const group = new Group();
    const { floor, boxes = [], walls = [] } = this.#scene ?? {};
    const quiet = this.#colour("--quiet");
    if (floor) {
      // One line a metre; fewer where that would be a grey field.
      const cell = span > 60 ? 10 : span > 30 ? 5 : 1;
      const cells = 2 * Math.ceil(span / 2 / cell);
      const line = this.#colour("--line");
      const grid = new GridHelper(cells * cell, cells, quiet, line.lerp(quiet, 0.35));
      grid.rotateX(MathUtils.degToRad(90));
      grid.position.set(Math.round(centre.x / cell) * cell, Math.round(centre.y / cell) * cell, floor.height);
      group.add(grid);
    }
    for (const { position, half_size, yaw = 0 } of boxes) {
      const geometry = new BoxGeometry(...new Vector3(...half_size).multiplyScalar(2).toArray());
      const box = new Mesh(geometry, new MeshLambertMaterial({ color: quiet, transparent: true, opacity: 0.28, depthWrite: false }));
      box.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: quiet })));
      box.position.fromArray(position);
      box.rotateZ(yaw);
      group.add(box);
    }
    for (const { point, normal } of walls) group.add(this.#wall(new Vector3(...point), new Vector3(...normal).normalize(), centre, span));
    return group;
  }

  #wall(point: Vector3, normal: Vector3, centre: Vector3, span: number): Object3D {
    const height = Math.min(3, span);
    const geometry = new PlaneGeometry(span, height);
    const quiet = this.#colour("--quiet");
    const wall = new Mesh(geometry, new MeshBasicMaterial({ color: quiet, transparent: true, opacity: 0.08, side: DoubleSide, depthWrite: false }));
    wall.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: quiet, transparent: true, opacity: 0.5 })));
    const middle = centre.clone();
    const floor = this.#scene?.floor;
    if (floor) middle.setZ(floor.height + height / 2);
    new Plane().setFromNormalAndCoplanarPoint(normal, point).projectPoint(middle, wall.position);
    wall.up.copy(UP);
    wall.lookAt(wall.position.clone().add(normal));
    return wall;
  }

  /** The camera as the pyramid that it sees, `length` deep. */
  #frustum(camera: Camera, length: number): Object3D {
    const { width, height, intrinsic } = camera;
    const toRay = new Matrix3().fromArray(intrinsic.flat()).transpose().invert();
    const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => new Vector3(u, v, 1).applyMatrix3(toRay).multiplyScalar(length));
    const lines = corners.flatMap((corner, index) => [new Vector3(), corner, corner, corners[(index + 1) % corners.length]!]);
    const frustum = new LineSegments(new BufferGeometry().setFromPoints(lines), new LineBasicMaterial({ color: this.#colour("--ink") }));
    frustum.applyMatrix4(worldFromCamera(camera));
    return frustum;
  }

  /** What is found frame by frame is noisy: dots on a thin line. The others are smooth: tubes, thick enough to be seen. */
  #path(name: PathName, points: Vector[]): Object3D {
    const color = this.#colour(COLOURS[name]);
    const places = points.map((point) => new Vector3(...point));
    if (name !== "found") {
      const curve = new CatmullRomCurve3(places);
      curve.arcLengthDivisions = Math.min(4 * places.length, 4000);
      const segments = Math.min(3 * places.length, 3000);
      return new Mesh(new TubeGeometry(curve, segments, this.#radius() * TUBE[name], 6), new MeshLambertMaterial({ color }));
    }
    const geometry = new BufferGeometry().setFromPoints(places);
    const line = new Line(geometry, new LineBasicMaterial({ color, transparent: true, opacity: 0.4 }));
    line.add(new Points(geometry, new PointsMaterial({ color, size: DOT * (this.#renderer?.getPixelRatio() ?? 1), sizeAttenuation: false })));
    return line;
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
    free(old);
    const object = draw();
    if (object) this.#stage.add(object);
    this.#drawn.set(name, { draw, object });
    this.#request();
  }

  /** In the colours of now. */
  #redraw(): void {
    for (const [name, { draw }] of [...this.#drawn]) this.#put(name, draw);
  }

  #describe(): void {
    if (!this.#renderer) return;
    const said: Record<PathName, string> = { truth: "true path", found: "positions frame by frame", fit: "fitted path" };
    const shown = (Object.keys(said) as PathName[]).filter((name) => (this.#paths[name]?.length ?? 0) > 1).map((name) => said[name]);
    const content = shown.length ? `the ball’s ${shown.join(", ")}` : "no path yet";
    this.#canvas.setAttribute("aria-label", `View in space: ${content}. Arrow keys turn it, plus and minus zoom, Home resets.`);
  }

  #resize(): void {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    // A hidden step has no size; it is drawn when it is shown.
    if (!width || !height) return;
    this.#renderer?.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.#renderer?.setSize(width, height, false);
    this.#eye.aspect = width / height;
    // What fits into a wide view fits into a narrow one, too.
    this.#eye.fov = width < height * 1.2 ? 58 : 45;
    this.#eye.updateProjectionMatrix();
    if (this.#scene && !this.#turned) this.#place();
    this.#request();
  }

  #request(): void {
    if (!this.#renderer || this.#requested) return;
    this.#requested = requestAnimationFrame(() => {
      this.#requested = 0;
      this.#renderer?.render(this.#stage, this.#eye);
    });
  }
}

function worldFromCamera(camera: Camera): Matrix4 {
  // Rows, where three.js wants columns.
  return new Matrix4().fromArray(camera.camera_from_world.flat()).transpose().invert();
}

/** Where a camera is, and a place in front of it. */
function poseOf(camera: Camera): { position: Vector3; ahead: Vector3 } {
  const matrix = worldFromCamera(camera);
  return { position: new Vector3().setFromMatrixPosition(matrix), ahead: new Vector3(0, 0, 6).applyMatrix4(matrix) };
}

/** How far from the middle of the view (1: the edge) the farthest corner of a box is. */
function outermost({ min, max }: Box3, eye: PerspectiveCamera): number {
  const corners = [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new Vector3(x, y, z).project(eye))));
  return Math.max(...corners.flatMap(({ x, y }) => [Math.abs(x), Math.abs(y)]));
}

function free(object: Object3D | null): void {
  object?.traverse((part) => {
    const { geometry, material } = part as Partial<Mesh>;
    geometry?.dispose();
    for (const each of [material ?? []].flat()) each.dispose();
  });
}
