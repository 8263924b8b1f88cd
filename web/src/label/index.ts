/** Step Label: clips in, proposals checked by a person, labels out. */
import type { Camera } from "gravisight";
import { make, textButton, wordsOf } from "../dom";
import { tools } from "../shared/core";
import { keepDrops, listenForFiles } from "../shared/drop-zone";
import { isVideo } from "../shared/film";
import { Alert, fill } from "../shared/panel";
import { arrow, decode, inside, PictureView, strokeOn, type Pixel, type Place } from "../shared/picture-view";
import { save } from "../shared/save";
import { workspace, type StoredClip } from "../shared/workspace";
import { csvOf, folderPicker, lineOf, nameOf, writeFolder } from "./export";
import { Labelling, type FrameState } from "./labelling";
import markup from "./panel.html?raw";
import { proposalsFor } from "./propose";
import { clipOfPictures, clipOfVideo, syntheticClip, syntheticId, type Watch } from "./sources";
import { STATES, Strip } from "./strip";
import "./style.css";

const COLOURS: Record<FrameState, string> = {
  sure: "#5ce1ff",
  doubtful: "#ffb547",
  accepted: "#62e39d",
  corrected: "#d49bff",
  hidden: "#ffffff",
  open: "#ffffff",
};
/** The ring is never smaller than this, CSS pixels. */
const LEAST_RING = 9;
/** Radius where nobody has measured it, picture pixels. */
const USUAL_RADIUS = 5;

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).open();
}

class Step {
  readonly #panel: HTMLElement;
  readonly #at: ReturnType<typeof fill>;
  readonly #alert: Alert;
  readonly #view: PictureView;
  readonly #strip: Strip;
  #labelling: Labelling | undefined;
  /** The frame that is wanted: pictures of others come too late. */
  #shown = 0;
  #busy: AbortController | undefined;
  /** The kept clip that is about to be deleted. */
  #doomed: string | undefined;

  constructor(panel: HTMLElement) {
    this.#panel = panel;
    this.#at = fill(panel, markup);
    this.#alert = new Alert(this.#at("lab-alert"));
    this.#view = new PictureView(this.#at("lab-frame"), "lab-picture", "lab-keys", {
      paint: (context, place) => this.#paint(context, place),
      press: (at) => {
        this.#labelling?.begin();
        this.#put(at);
      },
      drag: (at) => this.#put(at),
      release: () => this.#refresh(),
      // The panel listens, so that keys work wherever the focus is.
      key: () => false,
    });
    this.#strip = new Strip(this.#at("lab-strip"), this.#at("lab-key"), (frame) => {
      this.#go(frame);
      this.#view.overlay.focus({ preventScroll: true });
    });
    this.#listen();
  }

  async open(): Promise<void> {
    await this.#alert.during(async () => {
      this.#showCamera();
      await this.#listClips();
      const id = await Labelling.lastOpen();
      if (id !== undefined) await this.#openKept(id);
    });
  }

  #listen(): void {
    const on = (testId: string, act: () => unknown) => this.#at(testId).addEventListener("click", () => void act());
    const take = (files: File[]) => void this.#take(files);
    listenForFiles(this.#at("lab-drop"), this.#at<HTMLInputElement>("lab-files"), take);
    keepDrops(this.#panel, take);
    on("lab-synth", () => this.#synthesise());
    on("lab-cancel", () => this.#busy?.abort(new DOMException("cancelled", "AbortError")));
    on("lab-propose", () => this.#propose());
    on("lab-accept", () => this.#accept());
    on("lab-accept-sure", () => {
      const count = this.#labelling?.acceptSure() ?? 0;
      this.#say(`${count} sure ${count === 1 ? "label" : "labels"} accepted.`);
      this.#refresh();
    });
    on("lab-hidden", () => this.#hide());
    on("lab-undo", () => this.#undo());
    on("lab-previous", () => this.#step(-1));
    on("lab-next", () => this.#step(1));
    on("lab-recamera", () => this.#recamera());
    on("lab-save-jsonl", () => this.#export((clip) => save("clips.jsonl", lineOf(clip), "application/jsonl")));
    on("lab-save-csv", () => this.#export((clip) => save(`${nameOf(clip)}.csv`, csvOf(clip), "text/csv")));
    on("lab-save-pictures", () => this.#savePictures());
    const held = this.#at<HTMLInputElement>("lab-held");
    held.addEventListener("change", () => this.#labelling?.hold(held.checked));
    workspace.addEventListener("camera", () => {
      this.#showCamera();
      this.#refresh();
    });
    workspace.addEventListener("clips", () => void this.#listClips().catch(() => undefined));
    document.addEventListener("keydown", (event) => {
      if (!this.#panel.hidden && this.#labelling && this.#key(event)) event.preventDefault();
    });
    // Another step may read the clip next.
    addEventListener("hashchange", () => void this.#labelling?.flush());
    document.addEventListener("visibilitychange", () => void this.#labelling?.flush());
  }

  #key(event: KeyboardEvent): boolean {
    const target = event.target as HTMLElement;
    if (target !== document.body && !this.#panel.contains(target)) return false;
    if (target.matches('select, summary, input:not([type="checkbox"])')) return false;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !event.shiftKey) {
      this.#undo();
      return true;
    }
    if (event.ctrlKey || event.metaKey) return false;
    const direction = arrow(event.key);
    if (direction && event.altKey) {
      this.#nudge(direction);
      return true;
    }
    if (event.altKey || event.shiftKey) return false;
    if (direction && direction[0] !== 0) {
      this.#step(direction[0]);
      return true;
    }
    if (event.key === "n" || event.key === "N") {
      this.#hide();
      return true;
    }
    // A button that has the focus is pressed by Enter; the strip's is only where one stands.
    if (event.key === "Enter" && (!target.matches("button, input, label") || target.matches(".lab-strip .lab-cell"))) {
      this.#accept();
      return true;
    }
    return false;
  }

  // Where clips come from.

  async #take(files: File[]): Promise<void> {
    await this.#working(async (watch) => {
      const json = files.find((file) => /\.json$/i.test(file.name));
      if (json) workspace.camera = await cameraFrom(json);
      const rest = files.filter((file) => file !== json);
      if (rest.length === 0) return;
      const camera = workspace.camera;
      if (!camera) throw new Error("First a camera: a clip is kept together with the camera that took it. The step Calibrate gives one; or drop a camera.json here.");
      const fps = this.#number("lab-fps", 30);
      const most = Math.round(this.#number("lab-most", 300));
      const video = rest.find(isVideo);
      await this.#adopt(video ? await clipOfVideo(video, fps, most, camera, watch) : await clipOfPictures(rest, fps, most, camera));
    });
  }

  async #synthesise(): Promise<void> {
    await this.#working(async (watch) => {
      const environment = Number(this.#at<HTMLSelectElement>("lab-environment").value) as 1 | 2 | 3;
      const camera = Number(this.#at<HTMLSelectElement>("lab-synth-camera").value);
      const number = Math.round(this.#number("lab-number", 0));
      const id = syntheticId(environment, camera, number);
      if ((await workspace.clips()).includes(id)) {
        await this.#openKept(id);
        return this.#say("This clip was already kept: here it is, with its labels.");
      }
      await this.#adopt(await syntheticClip(environment, camera, number, watch));
    });
  }

  async #adopt(clip: StoredClip): Promise<void> {
    await this.#labelling?.flush();
    this.#use(await Labelling.fresh(clip, this.#full));
  }

  async #openKept(id: string): Promise<void> {
    await this.#labelling?.flush();
    const labelling = await Labelling.open(id, this.#full);
    if (labelling) this.#use(labelling);
  }

  #use(labelling: Labelling | undefined): void {
    this.#labelling = labelling;
    this.#at("lab-empty").hidden = labelling !== undefined;
    this.#at("lab-work").hidden = labelling === undefined;
    this.#say("");
    if (!labelling) return;
    this.#at("lab-title").textContent = labelling.clip.id;
    this.#at<HTMLInputElement>("lab-held").checked = labelling.clip.heldOut;
    this.#strip.fill(labelling.count);
    this.#go(labelling.frame);
    void this.#compare();
    void this.#listClips();
  }

  readonly #full = (thrown: unknown) => {
    this.#alert.say(`This browser could not keep the clip (${wordsOf(thrown)}). Save the labels to files before you close the page.`);
  };

  // What is kept.

  async #listClips(): Promise<void> {
    const ids = await workspace.clips();
    const rows = await Promise.all(ids.map(async (id) => this.#clipRow(id, await Labelling.counts(id))));
    const place = this.#at("lab-clips");
    const focused = (document.activeElement as HTMLElement | null)?.dataset.testid;
    const hadFocus = place.contains(document.activeElement);
    place.replaceChildren(...rows);
    if (hadFocus) place.querySelector<HTMLElement>(`[data-testid="${CSS.escape(focused ?? "")}"]`)?.focus();
    this.#at("lab-no-clips").hidden = ids.length > 0;
  }

  #clipRow(id: string, [labelled, all]: [number, number]): HTMLLIElement {
    const button = (text: string, testId: string, label: string, act: () => unknown) =>
      textButton(text, testId, `${label} ${id}`, () => void this.#alert.during(async () => void (await act())));
    const row = make("li", { testId: `lab-clip-${id}` });
    const isOpen = this.#labelling?.clip.id === id;
    if (isOpen) row.setAttribute("aria-current", "true");
    row.append(make("span", { class: "lab-clip-name", text: id }), make("small", { text: `${labelled} of ${all} labelled${isOpen ? " · open" : ""}` }));
    const doom = (doomed: string | undefined, focus: string) => async () => {
      this.#doomed = doomed;
      await this.#listClips();
      this.#at(`${focus}-${id}`).focus();
    };
    if (this.#doomed === id) {
      const answers = [
        button("Delete", `lab-delete-yes-${id}`, "Delete, really:", () => this.#delete(id)),
        button("Keep", `lab-delete-no-${id}`, "Keep", doom(undefined, "lab-delete")),
      ];
      row.append(make("strong", { text: "Delete it with its labels?" }), make("span", {}, ...answers));
    } else {
      if (!isOpen) row.append(button("Open", `lab-open-${id}`, "Open", () => this.#openKept(id)));
      row.append(button("Delete…", `lab-delete-${id}`, "Delete", doom(id, "lab-delete-no")));
    }
    return row;
  }

  async #delete(id: string): Promise<void> {
    this.#doomed = undefined;
    if (this.#labelling?.clip.id === id) {
      // Nothing of it may be written after it is gone.
      await this.#labelling.flush();
      this.#use(undefined);
    }
    await Labelling.forget(id);
    await this.#listClips();
  }

  // Proposals.

  async #propose(): Promise<void> {
    const labelling = this.#labelling;
    if (!labelling) return;
    await this.#working(async (watch) => {
      const proposals = await proposalsFor(labelling.clip, watch);
      labelling.propose(proposals);
      if (this.#labelling !== labelling) return;
      const found = proposals.filter((proposal) => proposal).length;
      const doubtful = proposals.filter((_, frame) => labelling.isDoubtful(frame)).length;
      const advice = doubtful > 0 ? `Check the ${doubtful} doubtful ${doubtful === 1 ? "frame" : "frames"}, then accept the sure ones.` : "All are sure: look at a few, then accept them.";
      this.#say(`The ball was found in ${found} of ${labelling.count} frames. ${advice}`);
      this.#refresh();
      await this.#compare();
    });
  }

  /** Proposals against the truth, where the simulator gave it. */
  async #compare(): Promise<void> {
    const labelling = this.#labelling;
    const place = this.#at("lab-truth");
    place.textContent = "";
    if (!labelling?.clip.truth || !labelling.isProposed) return;
    const truth = await (await tools()).project(labelling.clip.camera, labelling.clip.truth).catch(() => []);
    if (this.#labelling !== labelling) return;
    const within = truth.map((at, frame) => {
      const image = labelling.proposal(frame)?.image;
      return image && at ? (image[0] - at[0]) ** 2 + (image[1] - at[1]) ** 2 <= 1 : undefined;
    });
    const found = within.filter((is) => is !== undefined).length;
    place.textContent = `Against the simulation’s truth: ${within.filter(Boolean).length} of ${found} proposals are within 1 pixel.`;
  }

  /** One long thing at a time, with its progress and a way out. */
  async #working(work: (watch: Watch) => Promise<void>): Promise<void> {
    if (this.#busy) return this.#alert.say("Something is still being worked on. Wait for it, or cancel it.");
    const busy = (this.#busy = new AbortController());
    const bar = this.#at<HTMLProgressElement>("lab-progress");
    this.#say("");
    const show = (isBusy: boolean) => {
      this.#at("lab-busy").hidden = !isBusy;
      for (const testId of ["lab-propose", "lab-synth"]) this.#at<HTMLButtonElement>(testId).disabled = isBusy;
    };
    const progress = (done: number, all: number, words: string) => {
      if (all > 0) {
        bar.max = all;
        bar.value = done;
      } else bar.removeAttribute("value");
      this.#at("lab-busy-words").textContent = words;
    };
    progress(0, 0, "Reading…");
    show(true);
    await this.#alert.during(() => work({ signal: busy.signal, progress }));
    if (busy.signal.aborted) this.#say("Cancelled.");
    this.#busy = undefined;
    show(false);
  }

  // A person's labels.

  #put(at: Pixel): void {
    const label = inside([Number(at[0].toFixed(2)), Number(at[1].toFixed(2))], this.#view.size);
    this.#labelling?.put(label);
    this.#refresh();
  }

  #nudge([dx, dy]: Pixel): void {
    const { width, height } = this.#view.size;
    const at = this.#labelling?.at() ?? [(width - 1) / 2, (height - 1) / 2];
    this.#labelling?.begin(true);
    this.#labelling?.put(inside([at[0] + dx / 2, at[1] + dy / 2], { width, height }));
    this.#refresh();
  }

  #accept(): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    const isAccepted = labelling.accept();
    const next = labelling.following(this.#doubtfulOnly);
    if (next === undefined) this.#say(this.#doubtfulOnly ? "No doubtful frame is left." : "This was the last frame.");
    else this.#say(isAccepted ? "" : "Nothing is proposed in that frame: it stays without a label.");
    if (next === undefined) this.#refresh();
    else this.#go(next);
  }

  #hide(): void {
    this.#labelling?.begin();
    this.#labelling?.put(null);
    this.#refresh();
  }

  #undo(): void {
    const labelling = this.#labelling;
    if (labelling?.undo()) this.#go(labelling.frame);
  }

  get #doubtfulOnly(): boolean {
    return this.#at<HTMLInputElement>("lab-doubtful").checked;
  }

  #step(by: number): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    let frame = labelling.frame + by;
    if (this.#doubtfulOnly) while (frame >= 0 && frame < labelling.count && !labelling.isDoubtful(frame)) frame += by;
    this.#say("");
    if (frame >= 0 && frame < labelling.count) this.#go(frame);
    else if (this.#doubtfulOnly) this.#say("No doubtful frame lies further that way.");
  }

  // What is shown.

  #go(frame: number): void {
    if (!this.#labelling?.go(frame)) return;
    this.#refresh();
    void this.#showFrame();
  }

  async #showFrame(): Promise<void> {
    const labelling = this.#labelling;
    const picture = labelling?.clip.pictures[labelling.frame];
    if (!labelling || !picture) return;
    const shown = ++this.#shown;
    try {
      const bitmap = await decode(picture, `Frame ${labelling.frame + 1}`);
      if (shown !== this.#shown) return bitmap.close();
      this.#view.show(bitmap, `Frame ${labelling.frame + 1}: click the ball’s centre`);
    } catch (thrown) {
      this.#alert.say(wordsOf(thrown));
    }
  }

  #refresh(): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    const { frame, clip, count } = labelling;
    this.#strip.update(frame, (each) => labelling.state(each));
    this.#view.aim(labelling.at());
    this.#view.redraw();
    const states = clip.pictures.map((_, each) => labelling.state(each));
    const many = (...wanted: FrameState[]) => states.filter((state) => wanted.includes(state)).length;
    const state = labelling.state();
    const at = labelling.at();
    const sureness = state === "sure" || state === "doubtful" ? `, ${Math.round(100 * (labelling.proposal()?.confidence ?? 0))} % likely within a pixel` : "";
    this.#at("lab-state").replaceChildren(
      make("strong", { text: `Frame ${frame + 1} of ${count}` }),
      make("span", { class: "lab-tag", text: STATES[state].words, testId: "lab-tag" }),
      make("span", { class: "quiet", text: `${(clip.times[frame] ?? 0).toFixed(2)} s${at ? ` · pixel ${at.map((value) => value.toFixed(1)).join(", ")}` : ""}${sureness}` }),
    );
    this.#at("lab-tag").dataset.state = state;
    const sure = many("sure");
    this.#at("lab-count").textContent = `${many("accepted", "corrected", "hidden")} of ${count} frames labelled · ${sure} sure and ${many("doubtful")} doubtful proposals wait`;
    this.#at<HTMLButtonElement>("lab-accept-sure").disabled = sure === 0;
    this.#at<HTMLButtonElement>("lab-undo").disabled = !labelling.canUndo;
    const camera = workspace.camera;
    const another = camera && !clip.truth && JSON.stringify(camera) !== JSON.stringify(clip.camera);
    this.#at("lab-recamera").hidden = !another || camera.width !== clip.camera.width || camera.height !== clip.camera.height;
  }

  #paint(context: CanvasRenderingContext2D, place: Place): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    const state = labelling.state();
    const at = labelling.at();
    if (state === "hidden") return drawWords(context, "ball not visible");
    if (!at) return;
    const [x, y] = place(at);
    const [edge] = place([at[0] + (labelling.proposal()?.radiusPx ?? USUAL_RADIUS), at[1]]);
    const radius = Math.max(LEAST_RING, edge - x + 2);
    const path = new Path2D();
    path.arc(x, y, radius, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [0, 1], [-1, 0], [0, -1]] as const) {
      path.moveTo(x + dx * (radius + 3), y + dy * (radius + 3));
      path.lineTo(x + dx * (radius + 10), y + dy * (radius + 10));
    }
    // Dashes say that nobody has looked yet.
    context.setLineDash(state === "sure" || state === "doubtful" ? [6, 4] : []);
    strokeOn(context, path, COLOURS[state]);
    context.setLineDash([]);
  }

  #showCamera(): void {
    const camera = workspace.camera;
    this.#at("lab-camera").replaceChildren(
      ...(camera
        ? [document.createTextNode(`Camera: the calibrated one, for frames of ${camera.width} × ${camera.height} pixels.`)]
        : [document.createTextNode("No camera yet. "), linkTo("#calibrate", "Calibrate gives one"), document.createTextNode("; or drop a camera.json here.")]),
    );
  }

  async #recamera(): Promise<void> {
    const labelling = this.#labelling;
    const camera = workspace.camera;
    if (!labelling || !camera) return;
    labelling.clip.camera = camera;
    labelling.hold(labelling.clip.heldOut);
    this.#say("The clip has the calibrated camera now.");
    this.#refresh();
  }

  #say(words: string): void {
    this.#at("lab-said").textContent = words;
  }

  #number(testId: string, otherwise: number): number {
    const input = this.#at<HTMLInputElement>(testId);
    const value = input.valueAsNumber;
    return Number.isFinite(value) && input.validity.valid ? value : otherwise;
  }

  // Files.

  #export(write: (clip: StoredClip) => void): void {
    if (this.#labelling) write(this.#labelling.clip);
  }

  async #savePictures(): Promise<void> {
    const clip = this.#labelling?.clip;
    if (!clip) return;
    const pick = folderPicker();
    if (!pick) {
      save("clips.jsonl", lineOf(clip), "application/jsonl");
      this.#at("lab-export-note").textContent = `This browser cannot write a folder: only clips.jsonl was saved. Put the pictures beside it yourself, into a folder ${nameOf(clip)}, as the file names in it say; or use Chrome or Edge on a computer.`;
      return;
    }
    await this.#working(async ({ progress }) => {
      const folder = await pick({ id: "gravisight-clips", mode: "readwrite" });
      await writeFolder(folder, clip, (done, all) => progress(done, all, `Writing picture ${done + 1} of ${all}`));
      this.#say("Pictures and clips.jsonl are in the folder.");
    });
  }
}

function drawWords(context: CanvasRenderingContext2D, words: string): void {
  context.font = "600 15px system-ui, sans-serif";
  context.textBaseline = "bottom";
  context.lineJoin = "round";
  context.strokeStyle = "rgb(10 12 20 / 0.85)";
  context.lineWidth = 4;
  const at = [14, context.canvas.clientHeight - 12] as const;
  context.strokeText(words, ...at);
  context.fillStyle = "#ffffff";
  context.fillText(words, ...at);
}

function linkTo(address: string, words: string): HTMLAnchorElement {
  const link = make("a", { text: words });
  link.href = address;
  return link;
}

/** Reads a camera.json; the core checks what is in it when it is used. */
async function cameraFrom(file: File): Promise<Camera> {
  let camera: Partial<Camera> | null;
  try {
    camera = JSON.parse(await file.text()) as Partial<Camera> | null;
  } catch {
    throw new Error(`${file.name} is not JSON.`);
  }
  if (!camera?.width || !camera.height || !camera.intrinsic || !camera.camera_from_world) {
    throw new Error(`${file.name} is no camera.json: it needs width, height, intrinsic and camera_from_world.`);
  }
  // Its points are the world's own place: any will do to have the core look at it.
  await (await tools()).project(camera as Camera, [[0, 0, 0]]);
  return camera as Camera;
}
