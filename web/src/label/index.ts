/** Step Label: clips in, proposals checked by a person, labels out. */
import { make, messageOf } from "../dom";
import { tools } from "../shared/core";
import { listenForChosen, listenForDropped } from "../shared/drop-zone";
import { isJson, isVideo, otherToolsCamera, save } from "../shared/files";
import { cutIntoFlights, cutText } from "../shared/flights";
import { knownCameraFrom } from "../shared/known-camera";
import { Job, type Watch } from "../shared/job";
import { ModelSelect } from "../shared/model-select";
import { loadable } from "../shared/models";
import { Alert, fill, type Parts } from "../shared/panel";
import { workspace, type StoredClip } from "../shared/workspace";
import { ClipList } from "./clip-list";
import { Editor } from "./editor";
import { csvOf, folderPicker, lineOf, nameOf, writeFolder } from "./export";
import { Labelling } from "./labelling";
import markup from "./panel.html?raw";
import { Place } from "./place";
import { proposalsFor, type Proposed } from "./propose";
import { clipOfPictures, clipOfVideo, syntheticClip, syntheticId } from "./sources";
import "./style.css";

export async function start(panel: HTMLElement): Promise<void> {
  await new Step(panel).open();
}

class Step {
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #job: Job;
  readonly #editor: Editor;
  readonly #clips: ClipList;
  readonly #place: Place;
  readonly #models: ModelSelect;

  constructor(panel: HTMLElement) {
    this.#part = fill(panel, markup);
    this.#alert = new Alert(this.#part("lab-alert"));
    this.#job = new Job(this.#part("lab-busy"), "lab-cancel");
    this.#editor = new Editor(panel, this.#part, this.#alert);
    this.#place = new Place(this.#part, this.#alert, () => this.#labelling, (text) => {
      this.#editor.say(text);
      this.#showPlace();
    });
    this.#models = new ModelSelect(this.#part("lab-model"), this.#part("lab-model-field"));
    this.#clips = new ClipList(this.#part, this.#alert, {
      current: () => this.#labelling?.clip.id,
      open: (id) => this.#openKept(id),
      delete: (id) => this.#delete(id),
    });
    this.#listen(panel);
  }

  async open(): Promise<void> {
    await this.#alert.during(async () => {
      this.#showCamera();
      await this.#clips.update();
      const id = await Labelling.lastOpen();
      if (id !== undefined) await this.#openKept(id);
    });
  }

  get #labelling(): Labelling | undefined {
    return this.#editor.labelling;
  }

  #listen(panel: HTMLElement): void {
    const on = (name: string, act: () => unknown) => this.#part(name).addEventListener("click", () => void act());
    const take = (files: File[]) => void this.#take(files);
    listenForChosen(this.#part<HTMLInputElement>("lab-files"), take);
    listenForDropped(panel, this.#part("lab-drop"), take);
    on("lab-synth", () => this.#synthesise());
    on("lab-propose", () => this.#propose());
    on("lab-cut", () => this.#cut());
    on("lab-save-jsonl", () => this.#alert.during(async () => this.#export((clip) => save("clips.jsonl", lineOf(clip), "application/jsonl"))));
    on("lab-save-csv", () => this.#export((clip) => save(`${nameOf(clip)}.csv`, csvOf(clip), "text/csv")));
    on("lab-save-pictures", () => this.#alert.during(() => this.#savePictures()));
    workspace.addEventListener("camera", () => {
      this.#showCamera();
      this.#place.cameraChanged();
    });
    // Another step may read the clip next.
    addEventListener("hashchange", () => void this.#labelling?.flush());
    document.addEventListener("visibilitychange", () => void this.#labelling?.flush());
  }

  /** One long thing at a time, with its progress and a way out. */
  async #working(work: (watch: Watch) => Promise<void>): Promise<void> {
    if (this.#job.isRunning) return this.#alert.say("Another task is still running. Wait for it to finish, or cancel it.");
    const buttons = ["lab-propose", "lab-synth", "lab-cut"].map((name) => this.#part<HTMLButtonElement>(name));
    this.#editor.say("");
    for (const button of buttons) button.disabled = true;
    await this.#alert.during(() =>
      this.#job.run("Reading…", (watch) => {
        watch.signal.addEventListener("abort", () => this.#editor.say("Cancelled."));
        return work(watch);
      }),
    );
    for (const button of buttons) button.disabled = false;
    this.#showPlace();
  }

  // Where clips come from.

  async #take(files: File[]): Promise<void> {
    await this.#working(async (watch) => {
      const refusal = otherToolsCamera(files);
      if (refusal) throw new Error(refusal);
      const json = files.find(isJson);
      if (json) {
        const { camera, oneSigma } = await knownCameraFrom(json);
        workspace.setCamera(camera, oneSigma, { from: `dropped in the step Label as ${json.name}`, of: [] });
      }
      const rest = files.filter((file) => file !== json);
      if (rest.length === 0) return;
      const { camera } = workspace;
      const fps = this.#number("lab-fps", 30);
      const most = Math.round(this.#number("lab-most", 300));
      const video = rest.find(isVideo);
      const { clip, note } = video ? await clipOfVideo(video, fps, most, camera, watch) : await clipOfPictures(rest, fps, most, camera);
      await this.#adopt(clip, watch);
      // The clip is there all the same.
      if (note) throw new Error(note);
    });
  }

  async #synthesise(): Promise<void> {
    await this.#working(async (watch) => {
      const environment = Number(this.#part<HTMLSelectElement>("lab-environment").value) as 1 | 2 | 3;
      const camera = Number(this.#part<HTMLSelectElement>("lab-synth-camera").value);
      const number = Math.round(this.#number("lab-number", 0));
      const id = syntheticId(environment, camera, number);
      if ((await workspace.clips()).includes(id)) {
        await this.#openKept(id);
        return this.#editor.say("This clip is already kept in this browser: it was opened with its labels.");
      }
      await this.#adopt(await syntheticClip(environment, camera, number, watch), watch);
    });
  }

  async #adopt(clip: StoredClip, { signal }: Watch): Promise<void> {
    signal.throwIfAborted();
    await this.#labelling?.flush();
    this.#use(await Labelling.fresh(clip, this.#full));
  }

  async #openKept(id: string): Promise<void> {
    await this.#labelling?.flush();
    const labelling = await Labelling.open(id, this.#full);
    if (labelling) this.#use(labelling);
  }

  async #delete(id: string): Promise<void> {
    if (this.#labelling?.clip.id === id) {
      // Nothing of it may be written after it is gone.
      await this.#labelling.flush();
      this.#use(undefined);
    }
    await Labelling.forget(id);
  }

  #use(labelling: Labelling | undefined): void {
    this.#editor.open(labelling);
    if (!labelling) return;
    this.#showPlace();
    void this.#compare();
    void this.#clips.update();
  }

  readonly #full = (thrown: unknown) => {
    this.#alert.say(`This browser could not keep the clip (${messageOf(thrown)}). Save the labels to files before you close the page.`);
  };

  #number(name: string, otherwise: number): number {
    const input = this.#part<HTMLInputElement>(name);
    const value = input.valueAsNumber;
    return Number.isFinite(value) && input.validity.valid ? value : otherwise;
  }

  #showCamera(): void {
    const { camera } = workspace;
    const place = this.#part("lab-camera");
    if (camera) return place.replaceChildren(`Camera: the calibrated one, for frames of ${camera.width}\u00a0×\u00a0${camera.height} pixels.`);
    const link = make("a", { text: "Calibrate one" });
    link.href = "#calibrate";
    place.replaceChildren("No camera yet: clips can be labelled without one, in pixels. ", link, ", or drop a camera.json here.");
  }

  // Proposals.

  async #propose(): Promise<void> {
    const labelling = this.#labelling;
    if (!labelling) return;
    await this.#working(async (watch) => {
      const proposed = await proposalsFor(labelling.clip, await loadable(this.#models.choice), watch);
      labelling.propose(proposed);
      if (this.#labelling !== labelling) return;
      this.#editor.say(adviceOn(labelling, proposed));
      this.#editor.refresh();
      await this.#compare();
    });
  }

  /** One clip a flight. */
  async #cut(): Promise<void> {
    const labelling = this.#labelling;
    if (!labelling) return;
    await this.#working(async () => {
      const cut = await cutIntoFlights(labelling.clip, labelling.flights ?? [], (frame) => labelling.proposal(frame));
      for (const clip of cut.clips) await workspace.keep(clip);
      this.#editor.say(`${cutText(cut)} This clip stays as it is.`);
    });
  }

  /** What is known of the open clip, and whether it can be cut. */
  #showPlace(): void {
    const labelling = this.#labelling;
    this.#place.show();
    if (!labelling) return;
    const { clip, flights } = labelling;
    this.#part<HTMLButtonElement>("lab-cut").disabled = !flights?.length;
    const explained = flights?.filter(({ reason }) => reason === null).length ?? 0;
    this.#part("lab-flights").textContent = flights
      ? flights.length > 0
        ? `${flights.length} ${flights.length === 1 ? "flight" : "flights"} found; physics explains ${explained}. Fine-tune learns from clips of one flight.`
        : "No flight was found in this clip."
      : clip.camera && clip.scene
        ? "Propose labels to find the flights: Fine-tune learns from clips of one flight."
        : "With a camera, a place and a ball, “Propose labels” also finds the flights. Fine-tune learns from clips of one flight.";
  }

  /** Proposals against the truth, where the simulator gave it. */
  async #compare(): Promise<void> {
    const labelling = this.#labelling;
    const place = this.#part("lab-truth");
    place.textContent = "";
    if (!labelling?.clip.truth || !labelling.clip.camera || !labelling.isProposed) return;
    const truth = await (await tools()).project(labelling.clip.camera, labelling.clip.truth).catch(() => []);
    if (this.#labelling !== labelling) return;
    const within = truth.map((at, frame) => {
      const image = labelling.proposal(frame)?.image;
      return image && at ? (image[0] - at[0]) ** 2 + (image[1] - at[1]) ** 2 <= 1 : undefined;
    });
    const found = within.filter((is) => is !== undefined).length;
    place.textContent = `Against the simulation’s truth: ${within.filter(Boolean).length} of ${found} proposals are within 1 pixel.`;
  }

  // Files.

  #export(write: (clip: StoredClip) => void): void {
    if (this.#labelling) write(this.#labelling.clip);
  }

  async #savePictures(): Promise<void> {
    const clip = this.#labelling?.clip;
    if (!clip) return;
    const pick = clip.camera && folderPicker();
    if (!pick) {
      this.#export((each) => save("clips.jsonl", lineOf(each), "application/jsonl"));
      this.#part("lab-export-note").textContent = `This browser cannot write folders, so only clips.jsonl was saved. Put the pictures beside it into a folder ${nameOf(clip)}, under the file names in clips.jsonl, or use Chrome or Edge on a computer.`;
      return;
    }
    await this.#working(async ({ signal, progress }) => {
      const folder = await pick({ id: "gravisight-clips", mode: "readwrite" });
      await writeFolder(folder, clip, (done, all) => {
        signal.throwIfAborted();
        progress(done, all, `Writing picture ${done + 1} of ${all}`);
      });
      this.#editor.say("Pictures and clips.jsonl are in the folder.");
    });
  }
}

/** How many were found, in numbers that agree with those of the list. */
function adviceOn(labelling: Labelling, { proposals }: Proposed): string {
  const found = proposals.filter((proposal) => proposal).length;
  const doubtful = proposals.filter((proposal) => proposal?.doubtful).length;
  const counts = `The ball was found in ${found} of ${labelling.count} frames: ${found - doubtful} sure, ${doubtful} doubtful.`;
  const look = [doubtful > 0 && `the ${doubtful} doubtful`, found < proposals.length && `the ${proposals.length - found} without a proposal`].filter(Boolean).join(" and ");
  return `${counts} ${look ? `Check ${look}, then accept the sure ones.` : "Look at a few, then accept them."}`;
}
