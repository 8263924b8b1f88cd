/** Step Calibrate: clicks on known points of a picture become a camera. */
import type { CalibrationResult } from "gravisight";
import { make, wordsOf } from "../dom";
import { tools } from "../shared/core";
import { keepDrops, listenForFiles } from "../shared/drop-zone";
import { Film, isVideo } from "../shared/film";
import { Alert, fill } from "../shared/panel";
import { arrow, decode, inside, PictureView, type Pixel } from "../shared/picture-view";
import { save } from "../shared/save";
import { workspace } from "../shared/workspace";
import { offBy, PointList } from "./list";
import { paint } from "./marks";
import markup from "./panel.html?raw";
import { takeSample } from "./sample";
import { pointsFrom, State, wholeOf, type Given, type Point } from "./state";
import "./style.css";

/** After the last change, ms. */
const CALIBRATE_AFTER = 120;
const LEAST_POINTS = 4;

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).open();
}

class Step {
  readonly #panel: HTMLElement;
  readonly #at: ReturnType<typeof fill>;
  readonly #alert: Alert;
  readonly #view: PictureView;
  readonly #list: PointList;
  readonly #state = new State();
  /** The point that the next click places. */
  #current = 0;
  /** The point that the pointer placed last: keys make it exact. */
  #placed: number | undefined;
  /** What the pointer holds, and how far beside it. */
  #dragged: { index: number; beside: Pixel; isMoved: boolean } | undefined;
  /** Where Enter would place the next point. */
  #cross: Pixel | undefined;
  #found: CalibrationResult | undefined;
  #put: (Pixel | null)[] = [];
  #residuals = new Map<number, [number, number]>();
  #outliers = new Set<number>();
  #timer = 0;
  /** Of the calibration that is wanted; the answers of others come too late. */
  #run = 0;
  #size: { width: number; height: number } | undefined;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    this.#at = fill(panel, markup);
    this.#alert = new Alert(this.#at("cal-alert"));
    this.#view = new PictureView(this.#at("cal-frame"), "cal-picture", "cal-keys", {
      paint: (context, place) =>
        paint(context, place, {
          points: this.#points,
          moved: this.#moved,
          cross: this.#moved === undefined ? this.#cross : undefined,
          put: this.#put,
          outliers: this.#outliers,
          residuals: this.#residuals,
        }),
      press: (at, reach, event) => this.#press(at, event.altKey ? 0 : reach),
      drag: (at) => this.#drag(at),
      release: () => this.#release(),
      key: (event) => this.#key(event),
    });
    this.#list = new PointList(this.#at("cal-list"), {
      choose: (index) => this.#choose(index),
      unclick: (index) => this.#unclick(index),
      rename: (index, name) => this.#edit(index, (point) => (point.name = name)),
      place: (index, axis, metres) => this.#edit(index, (point) => (point.world[axis] = metres)),
      remove: (index) => this.#remove(index),
    });
    this.#listen();
  }

  async open(): Promise<void> {
    await this.#alert.during(async () => {
      await this.#state.restore();
      const { focal, distortion } = this.#state.lens;
      this.#at<HTMLInputElement>("cal-focal").value = String(focal ?? "");
      this.#at<HTMLInputElement>("cal-distortion").checked = distortion;
      if (this.#state.picture) await this.#show(this.#state.picture, this.#state.pictureName);
      this.#refill();
      const courts = await (await tools()).courts();
      const select = this.#at<HTMLSelectElement>("cal-court");
      select.append(...courts.map((name) => new Option(spoken(name), name)));
      // Not filled anew: the user may be writing already.
      select.value = this.#state.given.court;
    });
  }

  get #points(): Point[] {
    return this.#state.given.points;
  }

  /** The point that keys move: what was placed last, else the chosen one where it has a click. */
  get #moved(): number | undefined {
    if (this.#placed !== undefined && this.#points[this.#placed]?.click) return this.#placed;
    return this.#points[this.#current]?.click ? this.#current : undefined;
  }

  #listen(): void {
    const on = (testId: string, act: () => void) => this.#at(testId).addEventListener("click", act);
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    listenForFiles(this.#at("cal-drop"), this.#at<HTMLInputElement>("cal-file"), take);
    listenForFiles(this.#at("cal-load-label"), this.#at<HTMLInputElement>("cal-load"), take);
    keepDrops(this.#panel, take);
    on("cal-sample", () => void this.#alert.during(() => this.#takeSample()));
    on("cal-own", () => this.#change(() => (this.#state.given.court = "")));
    on("cal-add", () => {
      this.#change(() => this.#points.push({ name: "", world: [null, null, null], click: null }));
      this.#choose(this.#points.length - 1);
      this.#at(`cal-name-${this.#points.length - 1}`).focus();
    });
    on("cal-undo", () => this.#undo());
    on("cal-use", () => {
      if (!this.#found) return;
      workspace.camera = this.#found.camera;
      this.#say("This camera is now the one that the other steps use. It is kept in this browser.");
    });
    on("cal-save", () => {
      if (this.#found) save("camera.json", `${JSON.stringify(this.#found.camera, null, 1)}\n`);
    });
    on("cal-save-points", () => {
      if (this.#size) save("points.json", `${JSON.stringify(this.#state.asFile(this.#size.width, this.#size.height))}\n`);
    });
    const select = this.#at<HTMLSelectElement>("cal-court");
    select.addEventListener("change", () => void this.#alert.during(() => this.#takeCourt(select.value)));
    const focal = this.#at<HTMLInputElement>("cal-focal");
    const distortion = this.#at<HTMLInputElement>("cal-distortion");
    for (const input of [focal, distortion]) {
      input.addEventListener("input", () => {
        this.#state.lens = { focal: focal.valueAsNumber > 0 ? focal.valueAsNumber : null, distortion: distortion.checked };
        this.#changed();
      });
    }
    document.addEventListener("keydown", (event) => {
      if (this.#panel.hidden || !(event.ctrlKey || event.metaKey) || event.shiftKey || event.key.toLowerCase() !== "z") return;
      // In a field, the browser undoes what was written.
      if (event.target instanceof HTMLInputElement && event.target.type !== "checkbox") return;
      event.preventDefault();
      this.#undo();
    });
  }

  async #take(files: File[]): Promise<void> {
    const json = files.find((file) => /\.json$/i.test(file.name) || file.type === "application/json");
    const picture = files.find((file) => file !== json);
    if (picture && isVideo(picture)) {
      this.#at("cal-picture-name").textContent = "reading the video…";
      const film = await Film.open(picture);
      try {
        await this.#takePicture(await film.frame(0), picture.name);
      } finally {
        film.close();
      }
    } else if (picture) {
      await this.#takePicture(picture, picture.name);
    }
    if (json) {
      const { given, focal, leftOut } = await pointsFrom(await json.text(), json.name, this.#size, async (name) => (await (await tools()).court(name)).points);
      if (focal !== null) {
        this.#state.lens.focal = focal;
        this.#at<HTMLInputElement>("cal-focal").value = String(focal);
      }
      this.#change(() => (this.#state.given = given));
      if (leftOut) this.#say("Of the lens in that file, only the focal length was taken.");
      if (!this.#size) this.#at("cal-hint").textContent = "The points are there. Now choose the picture that they were clicked in.";
    }
  }

  async #takePicture(picture: Blob, name: string): Promise<void> {
    await this.#show(picture, name);
    this.#state.picture = picture;
    this.#state.pictureName = name;
    void this.#state.keepPicture();
    // The camera may have moved: clicks of the last picture say nothing about this one.
    if (this.#points.some((point) => point.click)) this.#change(() => this.#points.forEach((point) => (point.click = null)));
    else this.#changed();
  }

  async #takeSample(): Promise<void> {
    const { picture, name, points } = await takeSample();
    await this.#takePicture(picture, name);
    this.#change(() => (this.#state.given = { court: "", points }));
  }

  async #takeCourt(name: string): Promise<void> {
    const points: Given["points"] = [];
    if (name) {
      for (const [each, world] of Object.entries((await (await tools()).court(name)).points)) points.push({ name: each, world, click: null });
    }
    this.#change(() => (this.#state.given = { court: name, points }));
  }

  async #show(picture: Blob, name: string): Promise<void> {
    const bitmap = await decode(picture, name);
    this.#size = { width: bitmap.width, height: bitmap.height };
    this.#at("cal-empty").hidden = true;
    this.#at("cal-frame").hidden = false;
    this.#at("cal-picture-name").textContent = `${name}, ${bitmap.width} × ${bitmap.height} pixels`;
    this.#view.show(bitmap, `${name}: click the known points in it`);
    this.#cross = undefined;
    this.#view.aim(undefined);
  }

  /** Makes a change that can be undone, of which points there are. */
  #change(act: () => void): void {
    this.#state.remember();
    act();
    this.#placed = undefined;
    this.#refill();
    this.#changed();
  }

  #refill(): void {
    const { court, points } = this.#state.given;
    const own = court === "";
    this.#list.fill(points, own);
    const select = this.#at<HTMLSelectElement>("cal-court");
    select.value = court;
    this.#at("cal-own").hidden = own;
    this.#at("cal-add").hidden = !own;
    this.#at("cal-about").textContent = own ? "Metres; z points up. Where zero is and where x points is yours to choose." : "";
    if (!own) void tools().then(async (toolbox) => (this.#at("cal-about").textContent = (await toolbox.court(court)).about), () => undefined);
    this.#current = Math.max(0, this.#firstUnclicked());
    this.#changed();
  }

  #firstUnclicked(from = 0): number {
    const open = this.#points.flatMap((point, index) => (point.click ? [] : [index]));
    return open.find((index) => index >= from) ?? open[0] ?? -1;
  }

  #choose(index: number): void {
    this.#current = index;
    this.#placed = undefined;
    const click = this.#points[index]?.click;
    this.#view.aim(click ?? this.#cross);
    this.#say("");
    this.#refresh();
  }

  #press(at: Pixel, reach: number): void {
    const near = this.#points.flatMap(({ click }, index) => {
      if (!click) return [];
      const [dx, dy] = [click[0] - at[0], click[1] - at[1]];
      const far = dx * dx + dy * dy;
      return far <= reach * reach ? [{ index, far }] : [];
    });
    near.sort((a, b) => a.far - b.far);
    const grabbed = near[0]?.index;
    if (grabbed === undefined && !this.#points[this.#current]) {
      return this.#at("cal-next").replaceChildren("First choose a court, or add a point of your own.");
    }
    const held = grabbed === undefined ? undefined : this.#points[grabbed]?.click;
    this.#dragged = { index: grabbed ?? this.#current, beside: held ? [held[0] - at[0], held[1] - at[1]] : [0, 0], isMoved: false };
    // A point that is only touched keeps its place.
    if (!held) return this.#drag(at);
    this.#placed = grabbed;
    this.#refresh();
  }

  #drag(at: Pixel): void {
    const held = this.#dragged;
    const point = held && this.#points[held.index];
    if (!point || !this.#size) return;
    if (!held.isMoved) this.#state.remember();
    held.isMoved = true;
    point.click = inside([Number((at[0] + held.beside[0]).toFixed(2)), Number((at[1] + held.beside[1]).toFixed(2))], this.#size);
    this.#placed = held.index;
    this.#changed();
  }

  #release(): void {
    const held = this.#dragged;
    this.#dragged = undefined;
    if (!held) return;
    if (held.index === this.#current) this.#goOn(held.index);
    this.#view.aim(this.#points[held.index]?.click ?? undefined);
    if (held.isMoved) this.#changed();
    else this.#refresh();
  }

  /** Chooses the next point without a click. */
  #goOn(from: number): void {
    const next = this.#firstUnclicked(from);
    if (next >= 0) this.#current = next;
    this.#list.reveal(this.#current);
  }

  #key(event: KeyboardEvent): boolean {
    if (!this.#size || event.ctrlKey || event.metaKey || event.altKey) return false;
    const direction = arrow(event.key);
    const moved = this.#moved;
    const point = moved === undefined ? undefined : this.#points[moved];
    if (direction) {
      const step = event.shiftKey ? 0.1 : 1;
      const from = point?.click ?? this.#cross ?? [(this.#size.width - 1) / 2, (this.#size.height - 1) / 2];
      const to = inside([from[0] + step * direction[0], from[1] + step * direction[1]], this.#size);
      if (point) {
        this.#state.remember(`move ${moved}`);
        point.click = to;
      } else {
        this.#cross = to;
      }
      this.#view.aim(to);
      this.#changed();
      return true;
    }
    if (event.key === "Enter" || event.key === " ") {
      const next = this.#points[this.#current];
      if (next && !next.click && (this.#placed !== undefined || !this.#cross)) {
        // From the point that was just made exact to the next one: the cross starts where it was left.
        this.#cross ??= point?.click ?? [(this.#size.width - 1) / 2, (this.#size.height - 1) / 2];
        this.#placed = undefined;
        this.#view.aim(this.#cross);
      } else if (next && !next.click && this.#cross) {
        this.#state.remember();
        next.click = this.#cross;
        this.#goOn(this.#current);
      } else this.#goOn(this.#current);
      this.#changed();
      return true;
    }
    if ((event.key === "Delete" || event.key === "Backspace") && moved !== undefined) {
      this.#unclick(moved);
      return true;
    }
    return false;
  }

  #unclick(index: number): void {
    const point = this.#points[index];
    if (!point?.click) return;
    this.#state.remember();
    point.click = null;
    this.#placed = undefined;
    this.#current = index;
    this.#changed();
  }

  #edit(index: number, act: (point: Point) => void): void {
    const point = this.#points[index];
    if (!point) return;
    this.#state.remember(`edit ${index}`);
    act(point);
    this.#changed();
  }

  #remove(index: number): void {
    this.#change(() => this.#points.splice(index, 1));
    const next = Math.min(index, this.#points.length - 1);
    (next >= 0 ? this.#at(`cal-point-${next}`) : this.#at("cal-add")).focus();
  }

  #undo(): void {
    if (!this.#state.undo()) return;
    this.#placed = undefined;
    this.#refill();
  }

  #say(words: string): void {
    this.#at("cal-said").textContent = words;
  }

  /** Something has changed: keep it, show it, and calibrate when the user pauses. */
  #changed(): void {
    // What the last camera said is about other clicks.
    this.#residuals.clear();
    this.#say("");
    this.#refresh();
    void this.#state.keep();
    clearTimeout(this.#timer);
    this.#run += 1;
    if (this.#state.usable().length < LEAST_POINTS) return void this.#calibrate();
    this.#timer = window.setTimeout(() => void this.#calibrate(), CALIBRATE_AFTER);
  }

  #refresh(): void {
    const points = this.#points;
    this.#list.update(points, this.#current, (index) => ({ residual: this.#residuals.get(index), outlier: this.#outliers.has(index) }));
    this.#view.redraw();
    const usable = this.#state.usable().length;
    this.#at("cal-count").textContent = points.length > 0 ? `Points: ${usable} of ${points.length} clicked` : "Points";
    this.#at<HTMLButtonElement>("cal-undo").disabled = !this.#state.canUndo;
    this.#at<HTMLButtonElement>("cal-save-points").disabled = !this.#size || usable === 0;
    this.#at("cal-next").replaceChildren(...this.#nextWords());
  }

  #nextWords(): Node[] {
    const next = this.#points[this.#current];
    const nameOf = (index: number) => `${index + 1}. ${this.#points[index]?.name || "point"}`;
    if (!this.#size) return [];
    if (!next) return [make("span", { text: "Now choose a court, or add points of your own." })];
    const words: Node[] = [make("span", { text: next.click ? "A click moves " : "Next click: " }), make("strong", { text: nameOf(this.#current) })];
    const moved = this.#moved;
    if (moved !== undefined && moved !== this.#current) words.push(make("span", { text: ` · arrow keys move ${nameOf(moved)}` }));
    return words;
  }

  async #calibrate(): Promise<void> {
    const run = this.#run;
    const usable = this.#state.usable();
    const size = this.#size;
    if (!size || usable.length < LEAST_POINTS) return this.#showNone(this.#hint(usable.length));
    const { lens } = this.#state;
    try {
      const toolbox = await tools();
      const found = await toolbox.calibrate(this.#state.asFile(size.width, size.height), { estimate: lens.distortion ? ["distortion"] : [] });
      const whole = this.#points.flatMap((point, index) => {
        const place = wholeOf(point);
        return place ? [{ index, place }] : [];
      });
      const put = await toolbox.project(found.camera, whole.map(({ place }) => place));
      if (run !== this.#run) return;
      this.#put = [];
      for (const [order, { index }] of whole.entries()) this.#put[index] = put[order] ?? null;
      this.#showFound(found, usable);
    } catch (thrown) {
      if (run === this.#run) this.#showNone(sentence(wordsOf(thrown)));
    }
  }

  #hint(usable: number): string {
    if (!this.#size) return "First a picture, then points, then clicks: the camera appears here by itself.";
    const unplaced = this.#points.filter((point) => point.click && !wholeOf(point)).length;
    const more = LEAST_POINTS - usable;
    const missing = unplaced > 0 ? ` ${unplaced === 1 ? "One clicked point has" : `${unplaced} clicked points have`} no coordinates yet.` : "";
    return `${more} more ${more === 1 ? "point" : "points"} to click: four are enough where all lie in one plane, such as a floor; else six.${missing}`;
  }

  #showNone(why: string): void {
    this.#found = undefined;
    this.#put = [];
    this.#residuals.clear();
    this.#outliers.clear();
    this.#at("cal-hint").textContent = why;
    this.#at("cal-found").hidden = true;
    this.#at("cal-outliers").replaceChildren();
    this.#enable(false);
    this.#refresh();
  }

  #showFound(found: CalibrationResult, usable: number[]): void {
    this.#found = found;
    this.#residuals = new Map(usable.flatMap((index, order) => (found.residuals_px[order] ? [[index, found.residuals_px[order]]] : [])));
    this.#outliers = new Set(found.outliers.flatMap(({ index }) => usable[index] ?? []));
    this.#at("cal-hint").textContent = "";
    this.#at("cal-found").hidden = false;
    const { sigma, point_sigma } = found;
    const [[focal = NaN] = []] = found.camera.intrinsic;
    this.#number("cal-rms", [found.rms_px], (value) => value.toFixed(2));
    this.#number("cal-centre-sigma", sigma.centre, centimetres);
    this.#number("cal-point-sigma", point_sigma.world, centimetres);
    this.#number("cal-focal-found", [focal], (value) => value.toFixed(1) + (sigma.focal_px > 0 ? ` ± ${sigma.focal_px.toFixed(1)}` : ""));
    this.#at("cal-sigma-note").textContent = `Each along x, y and z; two times out of three the error is smaller. The ball: in the picture’s middle, ${point_sigma.depth.toFixed(1)} m from the camera, as far as the camera is to blame.`;
    this.#at("cal-outliers").replaceChildren(
      ...found.outliers.map(({ index, residual_px }) => {
        const point = usable[index] ?? 0;
        const item = make("li", {}, make("strong", { text: `Wrong click? ${point + 1}. ${this.#points[point]?.name || "point"}` }));
        item.append(` does not fit the others and was left out. The camera puts it ${offBy(residual_px)} from your click.`);
        return item;
      }),
    );
    this.#enable(true);
    this.#refresh();
  }

  #enable(isFound: boolean): void {
    for (const testId of ["cal-use", "cal-save"]) this.#at<HTMLButtonElement>(testId).disabled = !isFound;
  }

  #number(testId: string, values: number[], words: (value: number) => string): void {
    const place = this.#at<HTMLDataElement>(testId);
    place.value = values.join(" ");
    place.textContent = values.map(words).join(" · ");
  }
}

function centimetres(metres: number): string {
  const value = 100 * metres;
  return value < 0.05 ? "< 0.1" : value.toFixed(value < 10 ? 1 : 0);
}

/** A court's name as it is said. */
function spoken(name: string): string {
  const words = name.replaceAll("-", " ").replace(/\b(fiba|nba)\b/, (short) => `(${short.toUpperCase()})`);
  return words.charAt(0).toUpperCase() + words.slice(1);
}

function sentence(words: string): string {
  return `${words.charAt(0).toUpperCase()}${words.slice(1)}${/[.!?]$/.test(words) ? "" : "."}`;
}
