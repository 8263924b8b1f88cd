/** A ball to throw: the core simulates and draws it, the network finds it in each picture, and both are shown in space. */
import type { Localiser, Simulator, Vector } from "gravisight";
import { contextOf } from "../dom";
import { overlayOf, type Pixel } from "../shared/canvas";
import { SAMPLE_BALL, tools } from "../shared/core";
import { drawFound, drawTruth, stroke } from "../shared/marks";
import { Alert, fill, type Parts } from "../shared/panel";
import type { View3d } from "../shared/view3d";
import markup from "./panel.html?raw";
import "./style.css";

/** Pictures of a throw, and of a second. */
const FRAMES = 150;
const FPS = 60;
/** Metres a second for each metre that was dragged. */
const PUSH = 1.5;
/** Where a throw may start, metres: on the upright plane through the scene's middle that the picture is read by. */
const REACH = { across: 2, low: 0.4, high: 2.4, step: 0.1 };
/** Cameras that the model was trained on; the others are new to it. */
const TRAINED = 6;
const CAMERAS = 9;

interface Throw {
  position: Vector;
  velocity: Vector;
}

/** Fills `panel`; `localiser` is the page's, or none while it is loading. */
export function startLive(panel: HTMLElement, localiser: () => Localiser | undefined): void {
  new Live(panel, localiser);
}

class Live {
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #localiser: () => Localiser | undefined;
  #view: View3d | undefined;
  #scene: { simulator: Simulator; starts: Vector[]; places: (Pixel | null)[] } | undefined;
  #opening: { key: string; opened: Promise<void> } | undefined;
  #run = new AbortController();
  /** Where the pointer was pressed. */
  #pressed: Pixel | undefined;

  constructor(panel: HTMLElement, localiser: () => Localiser | undefined) {
    this.#part = fill(panel, markup);
    this.#alert = new Alert(this.#part("live-alert"));
    this.#localiser = localiser;
    const cameras = this.#part<HTMLSelectElement>("live-camera");
    for (let number = 1; number <= CAMERAS; number++) {
      cameras.append(new Option(number > TRAINED ? `${number} (never trained on)` : String(number), String(number)));
    }
    for (const select of [cameras, this.#part<HTMLSelectElement>("live-scene")]) {
      select.addEventListener("change", () => void this.#alert.during(() => this.#show()));
    }
    this.#part("live-throw").addEventListener("click", () => void this.#throw());
    this.#part("live-stop").addEventListener("click", () => this.#run.abort());
    this.#listenForDrags(this.#part<HTMLCanvasElement>("live-overlay"));
  }

  #listenForDrags(canvas: HTMLCanvasElement): void {
    canvas.addEventListener("pointerdown", (event) => {
      this.#pressed = placeOf(event, canvas);
      canvas.setPointerCapture(event.pointerId);
      void this.#alert.during(() => this.#show());
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.#pressed) return;
      const { context, width, height } = this.#overlay();
      const [from, to] = [this.#pressed, placeOf(event, canvas)];
      const path = new Path2D(`M${from[0] * width} ${from[1] * height}L${to[0] * width} ${to[1] * height}`);
      stroke(context, path, getComputedStyle(canvas).getPropertyValue("--found"), 3);
    });
    canvas.addEventListener("pointerup", (event) => {
      const pressed = this.#pressed;
      if (!pressed) return;
      this.#pressed = undefined;
      const released = placeOf(event, canvas);
      void this.#alert.during(async () => {
        await this.#show();
        const [from, to] = [this.#nearest(pressed), this.#nearest(released)];
        if (!from || !to) return;
        await this.#throw({ position: from, velocity: from.map((metres, axis) => PUSH * ((to[axis] ?? 0) - metres)) as Vector });
      });
    });
  }

  /** The start whose image is nearest to a place in the picture (0 to 1). */
  #nearest([x, y]: Pixel): Vector | undefined {
    const scene = this.#scene;
    if (!scene) return undefined;
    const { width, height } = scene.simulator.camera;
    let best: Vector | undefined;
    let least = Infinity;
    for (const [index, place] of scene.places.entries()) {
      if (!place) continue;
      const [dx, dy] = [place[0] - x * width, place[1] - y * height];
      if (dx * dx + dy * dy < least) [least, best] = [dx * dx + dy * dy, scene.starts[index]];
    }
    return best;
  }

  /** Opens the chosen scene, if it is not open, and shows it empty. Of two that were chosen, the later is shown. */
  async #show(): Promise<void> {
    const [environment, camera] = ["live-scene", "live-camera"].map((name) => Number(this.#part<HTMLSelectElement>(name).value)) as [1 | 2 | 3, number];
    const key = `${environment} ${camera}`;
    if (this.#opening?.key !== key) {
      this.#run.abort();
      this.#say("Fetching the scene…");
      // After the one before, so that nothing of it is shown later.
      const before = this.#opening?.opened.catch(() => undefined);
      const opening = { key, opened: Promise.resolve(before).then(() => this.#open(key, environment, camera)) };
      opening.opened.catch(() => {
        if (this.#opening === opening) this.#opening = undefined;
      });
      this.#opening = opening;
    }
    await this.#opening.opened;
  }

  async #open(key: string, environment: 1 | 2 | 3, camera: number): Promise<void> {
    if (this.#opening?.key !== key) return;
    const [toolbox, { View3d: View }] = await Promise.all([tools(), import("../shared/view3d")]);
    this.#scene?.simulator.dispose();
    this.#scene = undefined;
    const simulator = await toolbox.simulator({ environment, camera });
    const starts: Vector[] = [];
    for (let across = -REACH.across; across <= REACH.across; across += REACH.step) {
      for (let up = REACH.low; up <= REACH.high; up += REACH.step) starts.push([across, -across / 2, up]);
    }
    this.#scene = { simulator, starts, places: await toolbox.project(simulator.camera, starts) };
    this.#view ??= new View(this.#part<HTMLCanvasElement>("live-space"));
    this.#view.setScene(simulator.scene, simulator.camera);
    this.#view.setPath("truth", []);
    this.#view.setPath("found", []);
    this.#view.setBall("truth", null);
    this.#view.setBall("found", null);
    await this.#draw([0, 0, -1000]);
    this.#part("live-views").dataset.open = "";
    this.#overlay();
    if (this.#opening?.key === key) this.#say("Ready: press in the picture, drag and let go.");
  }

  async #throw(thrown?: Throw): Promise<void> {
    this.#run.abort();
    const run = new AbortController();
    await this.#alert.during(async () => {
      const localiser = this.#localiser();
      if (!localiser) throw new Error("The model is still loading; try again in a moment.");
      await this.#show();
      this.#run = run;
      this.#part<HTMLButtonElement>("live-stop").disabled = false;
      await this.#follow(localiser, thrown ?? atRandom(), run.signal);
    });
    if (this.#run === run) this.#part<HTMLButtonElement>("live-stop").disabled = true;
    if (run.signal.aborted) this.#say("Stopped. Throw another one.");
  }

  /** Lets the ball fly as fast as the pictures are found, at most as fast as time. */
  async #follow(localiser: Localiser, start: Throw, signal: AbortSignal): Promise<void> {
    const scene = this.#scene;
    if (!scene) return;
    const { simulator } = scene;
    const times = Array.from({ length: FRAMES }, (_, index) => index / FPS);
    const whole = await simulator.path(start, times);
    const images = await (await tools()).project(simulator.camera, whole);
    const { width, height } = simulator.camera;
    // A ball that has left the picture cannot be found.
    const left = images.findIndex((image) => !image || image[0] < 0 || image[1] < 0 || image[0] > width - 1 || image[1] > height - 1);
    const path = left < 0 ? whole : whole.slice(0, left);
    if (path.length === 0) throw new Error("This throw starts outside the picture. Press nearer to its middle.");
    this.#view?.setPath("truth", path);
    const found: Vector[] = [];
    let [sum, count, spent] = [0, 0, 0];
    this.#say("The ball is in the air.");
    const began = performance.now();
    for (const [index, centre] of path.entries()) {
      signal.throwIfAborted();
      // Frames that are late are left out, as a camera's would be.
      if (performance.now() - began > (index + 1) * (1000 / FPS) && index % 2 === 1) continue;
      const picture = await this.#draw(centre);
      const answer = await localiser.localise(picture, { ball: SAMPLE_BALL, camera: simulator.camera, truth: centre, signal });
      found.push(answer.world);
      [sum, count, spent] = [sum + (answer.dtg ?? 0), count + 1, spent + answer.milliseconds];
      this.#mark(answer.image, images[index] ?? undefined);
      this.#view?.setBall("truth", centre);
      this.#view?.setBall("found", answer.world);
      this.#view?.setPath("found", found);
      this.#write("live-error", answer.dtg ?? 0, (metres) => `${(100 * metres).toFixed(1)} cm`);
      this.#write("live-mean", sum / count, (metres) => `${(100 * metres).toFixed(1)} cm`);
      this.#write("live-time", spent / count, (milliseconds) => `${milliseconds.toFixed(0)} ms`);
      this.#write("live-count", count, String);
      await new Promise((resolve) => requestAnimationFrame(resolve));
    }
    this.#say(`Done: ${count} pictures, each localised on its own; mean error ${((100 * sum) / count).toFixed(1)} cm.`);
  }

  async #draw(centre: Vector): Promise<ImageData> {
    const scene = this.#scene;
    if (!scene) throw new Error("no scene is open");
    const { data, width, height } = await scene.simulator.picture(centre);
    const picture = new ImageData(data, width, height);
    contextOf(this.#part<HTMLCanvasElement>("live-picture")).putImageData(picture, 0, 0);
    return picture;
  }

  #mark(image: Pixel, truth: Pixel | undefined): void {
    const { context, toCanvas } = this.#overlay();
    drawFound(context, toCanvas(image));
    if (truth) drawTruth(context, toCanvas(truth));
  }

  /** The overlay, with nothing on it. */
  #overlay(): ReturnType<typeof overlayOf> {
    return overlayOf(this.#part<HTMLCanvasElement>("live-overlay"), this.#scene?.simulator.camera ?? { width: 1, height: 1 });
  }

  #write(name: string, value: number, format: (value: number) => string): void {
    const data = this.#part<HTMLDataElement>(name);
    data.value = String(value);
    data.textContent = format(value);
  }

  #say(text: string): void {
    this.#part("live-state").textContent = text;
  }
}

/** Where in the canvas, 0 to 1. */
function placeOf(event: PointerEvent, canvas: HTMLCanvasElement): Pixel {
  const { left, top, width, height } = canvas.getBoundingClientRect();
  return [(event.clientX - left) / width, (event.clientY - top) / height];
}

/** A throw inwards, upwards, and different each time. */
function atRandom(): Throw {
  const between = (low: number, high: number) => low + (high - low) * Math.random();
  const side = Math.random() < 0.5 ? -1 : 1;
  const [x, y] = [side * between(0.8, 1.6), between(-0.6, 0.6)];
  return { position: [x, y, between(1.2, 1.9)], velocity: [-x * between(0.3, 0.8), -y * between(0.3, 0.8), between(-1.5, 0.5)] };
}
