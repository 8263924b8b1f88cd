/** A clip being labelled: the proposals, a person's labels, and undo. */
import type { Camera, Scene } from "gravisight";
import { del, get, set } from "idb-keyval";
import type { Pixel } from "../shared/canvas";
import type { ClipFlight } from "../shared/flights";
import { workspace, type StoredClip } from "../shared/workspace";
import type { Proposal, Proposed } from "./propose";

export type FrameState = "sure" | "doubtful" | "accepted" | "corrected" | "hidden" | "open";

/** What is kept beside the clip: small, so that each label is safe at once. */
interface Notes {
  labels: StoredClip["labels"];
  /** Null where the ball was not seen; undefined where nobody looked. */
  proposals: (Proposal | null | undefined)[];
  /** Whether a person put the label elsewhere than proposed. */
  corrected: boolean[];
  frame: number;
  /** Those that the tracker found with camera, place and ball. */
  flights?: ClipFlight[];
}

interface Step {
  frame: number;
  changed: { frame: number; label: Pixel | null | undefined; corrected: boolean }[];
  /** Moves of one label are undone together. */
  move?: number;
}

const NOTES = "labelling ";
const OPEN = "label open";
/** The clip as a whole, with its pictures, is written when labelling pauses, ms. */
const KEEP_AFTER = 800;
/** ms */
const ONE_MOVE = 1000;

export class Labelling {
  readonly clip: StoredClip;
  frame = 0;
  #proposals: Notes["proposals"];
  #corrected: boolean[];
  /** Undefined where camera, place or ball have changed since, or were not known. */
  flights: ClipFlight[] | undefined;
  readonly #past: Step[] = [];
  #timer = 0;
  readonly #onFull: (thrown: unknown) => void;

  private constructor(clip: StoredClip, notes: Notes | undefined, onFull: (thrown: unknown) => void) {
    this.clip = clip;
    this.#onFull = onFull;
    const count = clip.pictures.length;
    const each = <T>(value: (index: number) => T) => Array.from({ length: count }, (_, index) => value(index));
    clip.labels = each((index) => (notes ? notes.labels[index] : clip.labels[index]));
    this.#proposals = each((index) => notes?.proposals[index]);
    this.#corrected = each((index) => notes?.corrected[index] ?? false);
    this.flights = notes?.flights;
    this.frame = Math.min(Math.max(notes?.frame ?? 0, 0), count - 1);
  }

  /** A clip that has just been read or made. */
  static async fresh(clip: StoredClip, onFull: (thrown: unknown) => void): Promise<Labelling> {
    const labelling = new Labelling(clip, undefined, onFull);
    // Without room it can still be labelled, and saved to files.
    await workspace.keep(clip).catch(onFull);
    await labelling.#note();
    return labelling;
  }

  static async open(id: string, onFull: (thrown: unknown) => void): Promise<Labelling | undefined> {
    const clip = await workspace.clip(id);
    if (!clip) return undefined;
    const labelling = new Labelling(clip, await get<Notes>(NOTES + id), onFull);
    await labelling.#note();
    return labelling;
  }

  /** The clip that was open last. */
  static async lastOpen(): Promise<string | undefined> {
    return get<string>(OPEN).catch(() => undefined);
  }

  static async forget(id: string): Promise<void> {
    await del(NOTES + id);
    await workspace.forget(id);
  }

  /** How many frames of a kept clip have a label, and how many there are. */
  static async counts(id: string): Promise<[number, number]> {
    const labels = (await get<Notes>(NOTES + id))?.labels ?? (await workspace.clip(id))?.labels ?? [];
    return [labels.filter((label) => label !== undefined).length, labels.length];
  }

  get count(): number {
    return this.clip.pictures.length;
  }

  get canUndo(): boolean {
    return this.#past.length > 0;
  }

  get isProposed(): boolean {
    return this.#proposals.some((proposal) => proposal !== undefined);
  }

  state(frame = this.frame): FrameState {
    const label = this.clip.labels[frame];
    if (label === null) return "hidden";
    if (label) return this.#corrected[frame] ? "corrected" : "accepted";
    const proposal = this.#proposals[frame];
    if (!proposal) return "open";
    return proposal.doubtful ? "doubtful" : "sure";
  }

  /** Where the label is, or is proposed. */
  at(frame = this.frame): Pixel | undefined {
    return this.clip.labels[frame] === null ? undefined : (this.clip.labels[frame] ?? this.#proposals[frame]?.image);
  }

  proposal(frame = this.frame): Proposal | null | undefined {
    return this.#proposals[frame];
  }

  /** Whether a person should look at the frame: nobody has, and the proposal is not sure. */
  isDoubtful(frame: number): boolean {
    return ["doubtful", "open"].includes(this.state(frame));
  }

  propose({ proposals, flights, about }: Proposed): void {
    this.#proposals = proposals;
    this.flights = flights;
    delete this.clip.filmed;
    delete this.clip.repeated;
    Object.assign(this.clip, about);
    this.#save();
  }

  /** Moves to a frame; false at the ends. */
  go(frame: number): boolean {
    if (frame < 0 || frame >= this.count) return false;
    this.frame = frame;
    void this.#note();
    return true;
  }

  /** The next frame, or the next doubtful one, from the start again at the end. */
  following(doubtfulOnly: boolean): number | undefined {
    if (!doubtfulOnly) return this.frame + 1 < this.count ? this.frame + 1 : undefined;
    const order = Array.from({ length: this.count }, (_, step) => (this.frame + 1 + step) % this.count);
    return order.find((frame) => this.isDoubtful(frame));
  }

  /** Accepts what is proposed; false where nothing is. */
  accept(): boolean {
    if (this.clip.labels[this.frame] !== undefined) return true;
    const image = this.#proposals[this.frame]?.image;
    if (!image) return false;
    this.#change([this.frame]);
    this.clip.labels[this.frame] = image;
    this.#save();
    return true;
  }

  /** Accepts all that are sure; returns how many. */
  acceptSure(): number {
    const sure = Array.from({ length: this.count }, (_, frame) => frame).filter((frame) => this.state(frame) === "sure");
    if (sure.length > 0) this.#change(sure);
    for (const frame of sure) this.clip.labels[frame] = this.#proposals[frame]?.image;
    this.#save();
    return sure.length;
  }

  /** Before the label of this frame is put somewhere; `isMove` joins what follows soon. */
  begin(isMove = false): void {
    const now = performance.now();
    const last = this.#past.at(-1);
    if (isMove && last?.move !== undefined && last.frame === this.frame && now - last.move < ONE_MOVE) last.move = now;
    else this.#change([this.frame], isMove ? now : undefined);
  }

  /** Puts the label of this frame, where a person says. */
  put(at: Pixel | null): void {
    this.clip.labels[this.frame] = at;
    this.#corrected[this.frame] = at !== null;
    this.#save();
  }

  undo(): boolean {
    const step = this.#past.pop();
    if (!step) return false;
    for (const { frame, label, corrected } of step.changed) {
      this.clip.labels[frame] = label;
      this.#corrected[frame] = corrected;
    }
    this.frame = step.frame;
    this.#save();
    return true;
  }

  setCamera(camera: Camera): void {
    this.clip.camera = camera;
    this.flights = undefined;
    this.#save();
  }

  /** Without a scene, the place is not known. */
  setScene(scene: Scene | undefined, sport: string | undefined): void {
    delete this.clip.scene;
    delete this.clip.sport;
    Object.assign(this.clip, scene && { scene }, sport && { sport });
    this.flights = undefined;
    this.#save();
  }

  hold(isHeldOut: boolean): void {
    this.clip.heldOut = isHeldOut;
    this.#save();
  }

  /** Writes what waits to be written. */
  async flush(): Promise<void> {
    if (!this.#timer) return;
    clearTimeout(this.#timer);
    this.#timer = 0;
    await workspace.keep(this.clip).catch(this.#onFull);
  }

  #change(frames: number[], move?: number): void {
    const changed = frames.map((frame) => ({ frame, label: this.clip.labels[frame], corrected: this.#corrected[frame] ?? false }));
    this.#past.push({ frame: this.frame, changed, ...(move === undefined ? {} : { move }) });
  }

  #save(): void {
    void this.#note();
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => void this.flush(), KEEP_AFTER);
  }

  async #note(): Promise<void> {
    const notes: Notes = { labels: this.clip.labels, proposals: this.#proposals, corrected: this.#corrected, frame: this.frame, ...(this.flights && { flights: this.flights }) };
    await Promise.all([set(NOTES + this.clip.id, notes), set(OPEN, this.clip.id)]).catch(this.#onFull);
  }
}
