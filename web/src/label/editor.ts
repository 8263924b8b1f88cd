/** The open clip, frame by frame: its picture, its strip of frames, and what a person says of them. */
import { make, messageOf } from "../dom";
import { decode, type Pixel } from "../shared/canvas";
import type { Alert, Parts } from "../shared/panel";
import { arrow, inside, PictureView } from "../shared/picture-view";
import type { FrameState, Labelling } from "./labelling";
import { paint } from "./marks";
import { STATES, Strip } from "./strip";

export class Editor {
  readonly #panel: HTMLElement;
  readonly #part: Parts;
  readonly #alert: Alert;
  readonly #view: PictureView;
  readonly #strip: Strip;
  #labelling: Labelling | undefined;
  /** Of the frame that is wanted: pictures of others come too late. */
  #shown = 0;

  constructor(panel: HTMLElement, part: Parts, alert: Alert) {
    this.#panel = panel;
    this.#part = part;
    this.#alert = alert;
    this.#view = new PictureView(part("lab-frame"), "lab-picture", "lab-keys", {
      paint: (context, toCanvas) => this.#labelling && paint(context, toCanvas, this.#labelling),
      press: (at) => {
        this.#labelling?.begin();
        this.#put(at);
      },
      drag: (at) => this.#put(at),
      release: () => this.refresh(),
      cancel: () => this.#undo(),
      // The page listens, so that keys work wherever the focus is.
      key: () => false,
    });
    this.#strip = new Strip(part("lab-strip"), part("lab-key"), (frame) => {
      this.#go(frame);
      this.#view.overlay.focus({ preventScroll: true });
    });
    const on = (name: string, act: () => void) => part(name).addEventListener("click", act);
    on("lab-accept", () => this.#accept());
    on("lab-accept-sure", () => this.#acceptSure());
    on("lab-hidden", () => this.#hide());
    on("lab-undo", () => this.#undo());
    on("lab-previous", () => this.#step(-1));
    on("lab-next", () => this.#step(1));
    const held = part<HTMLInputElement>("lab-held");
    held.addEventListener("change", () => this.#labelling?.hold(held.checked));
    document.addEventListener("keydown", (event) => {
      if (!panel.hidden && this.#labelling && this.#key(event)) event.preventDefault();
    });
  }

  get labelling(): Labelling | undefined {
    return this.#labelling;
  }

  open(labelling: Labelling | undefined): void {
    this.#labelling = labelling;
    this.#part("lab-empty").hidden = labelling !== undefined;
    this.#part("lab-work").hidden = labelling === undefined;
    this.say("");
    if (!labelling) return;
    this.#part("lab-title").textContent = labelling.clip.id;
    this.#part<HTMLInputElement>("lab-held").checked = labelling.clip.heldOut;
    this.#strip.fill(labelling.count);
    this.#go(labelling.frame);
  }

  say(text: string): void {
    this.#part("lab-said").textContent = text;
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

  // A person's labels.

  #put(at: Pixel): void {
    this.#labelling?.put(inside([Number(at[0].toFixed(2)), Number(at[1].toFixed(2))], this.#view.size));
    this.refresh();
  }

  #nudge([dx, dy]: Pixel): void {
    const { width, height } = this.#view.size;
    const at = this.#labelling?.at() ?? [(width - 1) / 2, (height - 1) / 2];
    this.#labelling?.begin(true);
    this.#labelling?.put(inside([at[0] + dx / 2, at[1] + dy / 2], { width, height }));
    this.refresh();
  }

  #accept(): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    const isAccepted = labelling.accept();
    const next = labelling.following(this.#doubtfulOnly);
    if (next === undefined) this.say(this.#doubtfulOnly ? "No doubtful frame is left." : "This was the last frame.");
    else this.say(isAccepted ? "" : "That frame has no proposal and stays unlabelled.");
    if (next === undefined) this.refresh();
    else this.#go(next);
  }

  #acceptSure(): void {
    const count = this.#labelling?.acceptSure() ?? 0;
    this.say(`${count} sure ${count === 1 ? "label" : "labels"} accepted.`);
    this.refresh();
  }

  #hide(): void {
    this.#labelling?.begin();
    this.#labelling?.put(null);
    this.refresh();
  }

  #undo(): void {
    const labelling = this.#labelling;
    if (labelling?.undo()) this.#go(labelling.frame);
  }

  // Which frame is shown, and how.

  get #doubtfulOnly(): boolean {
    return this.#part<HTMLInputElement>("lab-doubtful").checked;
  }

  #step(by: number): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    let frame = labelling.frame + by;
    if (this.#doubtfulOnly) while (frame >= 0 && frame < labelling.count && !labelling.isDoubtful(frame)) frame += by;
    this.say("");
    if (frame >= 0 && frame < labelling.count) this.#go(frame);
    else if (this.#doubtfulOnly) this.say("There are no more doubtful frames in that direction.");
  }

  #go(frame: number): void {
    if (!this.#labelling?.go(frame)) return;
    this.refresh();
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
      this.#alert.say(messageOf(thrown));
    }
  }

  refresh(): void {
    const labelling = this.#labelling;
    if (!labelling) return;
    const { frame, clip, count } = labelling;
    this.#strip.update(frame, (each) => labelling.state(each));
    this.#view.aim(labelling.at());
    this.#view.redraw();
    this.#showState(labelling);
    const states = clip.pictures.map((_, each) => labelling.state(each));
    const many = (...chosen: FrameState[]) => states.filter((state) => chosen.includes(state)).length;
    const sure = many("sure");
    this.#part("lab-count").textContent = `${many("accepted", "corrected", "hidden")} of ${count} frames labelled · ${sure} sure and ${many("doubtful")} doubtful proposals to review${labelling.isProposed ? ` · ${many("open")} without a proposal` : ""}`;
    this.#part<HTMLButtonElement>("lab-accept-sure").disabled = sure === 0;
    this.#part<HTMLButtonElement>("lab-undo").disabled = !labelling.canUndo;
  }

  #showState(labelling: Labelling): void {
    const { frame, clip, count } = labelling;
    const state = labelling.state();
    const at = labelling.at();
    const pixel = at ? ` · pixel ${at.map((value) => value.toFixed(1)).join(", ")}` : "";
    const sureness = state === "sure" || state === "doubtful" ? `, ${Math.round(100 * (labelling.proposal()?.confidence ?? 0))} % likely within a pixel` : "";
    const tag = make("span", { class: "lab-tag", text: STATES[state].label, part: "lab-tag" });
    tag.dataset.state = state;
    this.#part("lab-state").replaceChildren(
      make("strong", { text: `Frame ${frame + 1} of ${count}` }),
      tag,
      make("span", { class: "quiet", text: `${(clip.times[frame] ?? 0).toFixed(2)} s${pixel}${sureness}` }),
    );
  }
}
