/** Step Calibrate: clicks on known points of a picture become a camera. */
import { messageOf } from "../dom";
import { decode } from "../shared/canvas";
import { tools } from "../shared/core";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, isVideo, otherToolsCamera, readJson, save } from "../shared/files";
import { Film } from "../shared/film";
import { findableCourt } from "../shared/find-court";
import { Alert, fill, type Parts } from "../shared/panel";
import { PictureView } from "../shared/picture-view";
import { workspace } from "../shared/workspace";
import { calibrated, type Calibration } from "./calibration";
import { Clicks } from "./clicks";
import { CourtMap } from "./court-map";
import { courtPoints } from "./court-points";
import { Finder } from "./finder";
import { PointList, type Standing } from "./list";
import { paint } from "./marks";
import { nameOf, nextStep, stillNeeded } from "./next-step";
import { Nudge } from "./nudge";
import markup from "./panel.html?raw";
import { Progress } from "./progress";
import { Result } from "./result";
import { takeSample } from "./sample";
import { pointsFrom, State, unclicked, type Point } from "./state";
import "./style.css";
import { sentences, spoken } from "./words";

/** After the last change, ms. */
const CALIBRATE_AFTER = 120;
const LEAST_POINTS = 4;

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).open();
}

class Step {
  readonly #panel: HTMLElement;
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #view: PictureView;
  readonly #list: PointList;
  readonly #map: CourtMap;
  readonly #nudge: Nudge;
  readonly #progress: Progress;
  readonly #result: Result;
  readonly #state = new State();
  readonly #clicks: Clicks;
  readonly #finder: Finder;
  #calibration: Calibration | undefined;
  #timer = 0;
  /** The step that requested a camera. */
  #back = "";
  /** Of the calibration that is wanted; the answers of others come too late. */
  #run = 0;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    this.#part = fill(panel, markup);
    this.#alert = new Alert(this.#part("cal-alert"));
    this.#result = new Result(this.#part);
    this.#progress = new Progress(this.#part);
    this.#nudge = new Nudge(this.#part, (way, step) => clicks.nudge(way, step));
    this.#map = new CourtMap(this.#part("cal-map"), (index) => this.#choose(index));
    const clicks = (this.#clicks = new Clicks(this.#state, {
      changed: () => this.#changed(),
      chosen: () => this.#refresh(),
      aim: (at) => this.#view.aim(at),
      reveal: (index) => this.#list.reveal(index),
    }));
    this.#view = new PictureView(this.#part("cal-frame"), "cal-picture", "cal-keys", {
      paint: (context, toCanvas) =>
        paint(context, toCanvas, { points: this.#points, moved: clicks.moved, cross: clicks.cross, calibration: this.#calibration, isAsked: this.#state.isAsked }),
      press: (at, reach, event) => {
        if (!clicks.press(at, event.altKey ? 0 : reach)) this.#part("cal-next").replaceChildren("First choose a court, or add a point of your own.");
      },
      drag: (at) => clicks.drag(at),
      release: () => clicks.release(),
      cancel: () => {
        const { current } = clicks;
        if (clicks.cancel()) this.#undo();
        this.#choose(current);
      },
      key: (event) => clicks.key(event),
    });
    this.#list = new PointList(this.#part("cal-list"), {
      choose: (index) => this.#choose(index),
      unclick: (index) => clicks.unclick(index),
      rename: (index, name) => this.#edit(index, (point) => (point.name = name)),
      place: (index, axis, metres) => this.#edit(index, (point) => (point.world[axis] = metres)),
      remove: (index) => this.#remove(index),
    });
    this.#finder = new Finder(this.#part, this.#state, {
      change: (given) => this.#change(() => (this.#state.given = given)),
      size: () => clicks.size,
      answered: () => this.#view.overlay.focus({ preventScroll: true }),
    });
    this.#listen();
  }

  async open(): Promise<void> {
    await this.#alert.during(async () => {
      await this.#state.restore();
      const { focal, distortion } = this.#state.lens;
      this.#part<HTMLInputElement>("cal-focal").value = String(focal ?? "");
      this.#part<HTMLInputElement>("cal-distortion").checked = distortion;
      if (this.#state.picture) await this.#show(this.#state.picture, this.#state.pictureName);
      this.#refill();
      const courts = await (await tools()).courts();
      const select = this.#part<HTMLSelectElement>("cal-court");
      select.append(...courts.map((name) => new Option(spoken(name), name)));
      // Not filled anew: the user may be writing already.
      select.value = this.#state.given.court;
      await this.#takeWish();
    });
    workspace.addEventListener("calibrate", () => void this.#alert.during(() => this.#takeWish()));
  }

  get #points(): Point[] {
    return this.#state.given.points;
  }

  #listen(): void {
    const on = (name: string, act: () => void) => this.#part(name).addEventListener("click", act);
    const take = (files: File[]) => void this.#alert.during(() => this.#take(files));
    for (const name of ["cal-file", "cal-load"]) listenForChosen(this.#part<HTMLInputElement>(name), take);
    listenForDropped(this.#panel, this.#part("cal-drop"), take);
    on("cal-sample", () => void this.#alert.during(() => this.#takeSample()));
    on("cal-own", () => this.#change(() => (this.#state.given = { court: "", points: this.#points })));
    on("cal-add", () => {
      this.#change(() => this.#points.push({ name: "", world: [null, null, null], click: null }));
      this.#choose(this.#points.length - 1);
      this.#part(`cal-name-${this.#points.length - 1}`).focus();
    });
    on("cal-undo", () => this.#undo());
    on("cal-absent", () => this.#clicks.toggleAbsent());
    on("cal-use", () => {
      if (!this.#calibration) return;
      const { pictureName, pictureOf, given: { court } } = this.#state;
      workspace.setCamera(this.#calibration.found.camera, this.#calibration.found.oneSigma, { from: `calibrated on ${pictureName}`, of: [pictureOf], court });
      this.#say("The other steps now use this camera for pictures of this size. It is kept in this browser.");
      if (this.#back) location.hash = this.#back;
      this.#showBack("");
    });
    on("cal-save", () => {
      if (this.#calibration) save("camera.json", `${JSON.stringify(this.#calibration.found.camera, null, 1)}\n`);
    });
    on("cal-save-points", () => {
      const { size } = this.#clicks;
      if (size) save("points.json", `${JSON.stringify(this.#state.asFile(size.width, size.height))}\n`);
    });
    const select = this.#part<HTMLSelectElement>("cal-court");
    select.addEventListener("change", () => void this.#alert.during(() => this.#takeCourt(select.value)));
    const focal = this.#part<HTMLInputElement>("cal-focal");
    const distortion = this.#part<HTMLInputElement>("cal-distortion");
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

  // What is given: a picture, points, a lens.

  async #take(files: File[]): Promise<void> {
    const refusal = otherToolsCamera(files);
    if (refusal) throw new Error(refusal);
    const json = files.find(isJson);
    const picture = files.find((file) => file !== json);
    if (picture && isVideo(picture)) {
      await this.#takeVideo(picture);
    } else if (picture) {
      await this.#takePicture(picture, picture.name);
    }
    if (picture && !json && (await findableCourt(this.#state.given.court))) void this.#finder.find();
    if (json) {
      const content = await readJson(json);
      const { given, focal, leftOut } = await pointsFrom(content, json.name, this.#clicks.size, courtPoints);
      if (focal !== null) {
        this.#state.lens.focal = focal;
        this.#part<HTMLInputElement>("cal-focal").value = String(focal);
      }
      this.#change(() => (this.#state.given = given));
      if (leftOut) this.#say("Only the focal length of the lens in that file is used.");
      if (!this.#clicks.size) this.#result.hint("The points are loaded. Now choose the picture in which they were clicked.");
    }
  }

  /** Its first frame. */
  async #takeVideo(video: File): Promise<void> {
    const place = this.#part("cal-picture-name");
    const before = place.textContent;
    const reading = (place.textContent = "reading the video…");
    try {
      const film = await Film.open(video);
      try {
        await this.#takePicture(await film.frame(0), video.name);
      } finally {
        film.close();
      }
    } finally {
      if (place.textContent === reading) place.textContent = before;
    }
  }

  async #takePicture(picture: Blob, name: string, of = name): Promise<void> {
    await this.#show(picture, name);
    this.#state.picture = picture;
    [this.#state.pictureName, this.#state.pictureOf] = [name, of];
    void this.#state.keepPicture();
    // The camera may have moved: clicks of the last picture say nothing about this one.
    const { court } = this.#state.given;
    if (this.#points.some((point) => point.click || point.isAbsent)) this.#change(() => (this.#state.given = { court, points: this.#points.map(unclicked) }));
    else this.#changed();
  }

  /** Another step asks for the camera of a picture. */
  async #takeWish(): Promise<void> {
    const { wish } = workspace;
    if (!wish) return;
    workspace.wish = undefined;
    await this.#takePicture(wish.picture, wish.name, wish.of);
    const court = [...this.#part<HTMLSelectElement>("cal-court").options].map(({ value }) => value).find((name) => name !== "" && name.startsWith(wish.sport));
    if (wish.sport && court && court !== this.#state.given.court) await this.#takeCourt(court);
    this.#showBack(wish.back);
    if (wish.search) await this.#finder.take(wish.search);
    else if (wish.sport && (await findableCourt(this.#state.given.court))) void this.#finder.find();
  }

  #showBack(step: string): void {
    this.#back = step;
    this.#part("cal-use").textContent = step ? "Use this camera and go back" : "Use this camera";
  }

  async #takeSample(): Promise<void> {
    const { picture, name, points } = await takeSample();
    await this.#takePicture(picture, name);
    this.#change(() => (this.#state.given = { court: "", points }));
  }

  async #takeCourt(name: string): Promise<void> {
    const points = name ? (await courtPoints(name)).map(([each, world]): Point => ({ name: each, world, click: null })) : [];
    this.#change(() => (this.#state.given = { court: name, points }));
  }

  async #show(picture: Blob, name: string): Promise<void> {
    const bitmap = await decode(picture, name);
    this.#part("cal-empty").hidden = true;
    this.#part("cal-frame").hidden = false;
    this.#part("cal-picture-name").textContent = `${name}, ${bitmap.width} × ${bitmap.height} pixels`;
    this.#view.show(bitmap, `${name}: click the known points in it`);
    this.#view.showAll();
    this.#clicks.open({ width: bitmap.width, height: bitmap.height });
    void this.#showFindable(this.#state.given.court);
  }

  // What is changed.

  /** Makes a change that can be undone, of which points there are. */
  #change(act: () => void): void {
    this.#state.remember();
    act();
    this.#refill();
  }

  #refill(): void {
    const { court, points } = this.#state.given;
    const own = court === "";
    this.#list.fill(points, own);
    const select = this.#part<HTMLSelectElement>("cal-court");
    select.value = court;
    this.#part("cal-own").hidden = own;
    this.#part("cal-add").hidden = !own;
    this.#part("cal-about").textContent = own ? "In metres; z points up. You choose the origin and the direction of x." : "";
    this.#part("cal-map-card").hidden = own;
    if (!own) void this.#showCourt(court).catch(() => undefined);
    void this.#showFindable(court);
    this.#clicks.restart();
    this.#list.reveal(this.#clicks.current);
    this.#changed();
  }

  async #showCourt(court: string): Promise<void> {
    const { about, lines } = await (await tools()).court(court);
    if (court !== this.#state.given.court) return;
    this.#part("cal-about").textContent = about;
    this.#map.fill(this.#points, lines ?? []);
    this.#refresh();
  }

  /** Courts can be found whose lines are known. */
  async #showFindable(court: string): Promise<void> {
    const isFindable = court === "" || (await findableCourt(court).catch(() => undefined)) !== undefined;
    if (court !== this.#state.given.court) return;
    this.#part<HTMLButtonElement>("cal-find").disabled = !isFindable || !this.#clicks.size;
    this.#part("cal-find-not").hidden = isFindable;
  }

  #choose(index: number): void {
    this.#say("");
    this.#clicks.choose(index);
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
    (next >= 0 ? this.#part(`cal-point-${next}`) : this.#part("cal-add")).focus();
  }

  #undo(): void {
    if (this.#state.undo()) this.#refill();
  }

  #say(text: string): void {
    this.#part("cal-said").textContent = text;
  }

  /** Something has changed: keep it, show it, and calibrate when the user pauses. */
  #changed(): void {
    // The last camera's residuals are of other clicks.
    this.#calibration?.residuals.clear();
    this.#say("");
    this.#finder.stop();
    this.#refresh();
    void this.#state.keep();
    clearTimeout(this.#timer);
    this.#run += 1;
    if (!this.#clicks.size || this.#state.usable().length < LEAST_POINTS) return void this.#calibrate();
    this.#result.await();
    this.#progress.start();
    this.#timer = window.setTimeout(() => void this.#calibrate(), CALIBRATE_AFTER);
  }

  #refresh(): void {
    const points = this.#points;
    const { current } = this.#clicks;
    const standing = (index: number): Standing => ({
      residual: this.#calibration?.residuals.get(index),
      outlier: this.#calibration?.outliers.has(index) ?? false,
    });
    this.#list.update(points, current, standing);
    this.#map.update(points, current, standing);
    this.#nudge.enable(this.#clicks.moved !== undefined || this.#clicks.cross !== undefined);
    this.#part<HTMLButtonElement>("cal-absent").disabled = !this.#clicks.size || !points[current];
    this.#part("cal-absent").textContent = points[current]?.isAbsent ? "It is in the picture" : "Not in the picture";
    this.#view.redraw();
    const usable = this.#state.usable().length;
    this.#part("cal-count").textContent = points.length > 0 ? `Points: ${usable} of ${points.length} ${this.#state.placing ? "placed" : "clicked"}` : "Points";
    this.#part<HTMLButtonElement>("cal-undo").disabled = !this.#state.canUndo;
    this.#part<HTMLButtonElement>("cal-save-points").disabled = !this.#clicks.size || usable === 0;
    this.#part("cal-next").replaceChildren(...nextStep(points, this.#clicks, this.#state.placing !== undefined));
  }

  async #calibrate(): Promise<void> {
    const run = this.#run;
    const { size } = this.#clicks;
    const usable = this.#state.usable().length;
    if (!size || usable < LEAST_POINTS) return this.#showNone(...stillNeeded(this.#points, size !== undefined, LEAST_POINTS - usable));
    try {
      const calibration = await calibrated(this.#state, size);
      if (run !== this.#run) return;
      this.#calibration = calibration;
      this.#result.show(calibration, (index) => nameOf(this.#points, index), this.#state.isAsked);
      this.#progress.end(`Camera found: ${calibration.found.rmsPx.toFixed(2)} pixels from the points.`);
      this.#refresh();
    } catch (thrown) {
      if (run === this.#run) this.#showNone(sentences(messageOf(thrown)), "No camera fits these points yet: see “The camera”.");
    }
  }

  #showNone(why: string, short: string): void {
    this.#calibration = undefined;
    this.#result.showNone(why);
    this.#progress.end(short);
    this.#refresh();
  }
}
