/** The court is looked for in the picture: the search, what it found, and the questions that it leaves. */
import type { CourtSearch } from "gravisight";
import { messageOf } from "../dom";
import { courtInWords, findCourt, percentOf } from "../shared/find-court";
import type { Parts } from "../shared/panel";
import { canTurn, givenBy, givenByOther, turned } from "./placed";
import { unclicked, type Given, type State } from "./state";

interface FinderListener {
  /** The points are others now; it can be undone. */
  change(given: Given): void;
  /** The picture's size, where there is one. */
  size(): { width: number; height: number } | undefined;
  /** The answer was given: the keyboard goes on in the picture. */
  answered(): void;
}

export class Finder {
  readonly #part: Parts;
  readonly #state: State;
  readonly #listener: FinderListener;
  #running: AbortController | undefined;
  /** What became of a search that found nothing. */
  #inVain = "";

  constructor(part: Parts, state: State, listener: FinderListener) {
    this.#part = part;
    this.#state = state;
    this.#listener = listener;
    const on = (name: string, act: () => void) => part(name).addEventListener("click", act);
    on("cal-find", () => (this.#running ? this.stop() : void this.find()));
    on("cal-find-yes", () => this.#answer(true));
    on("cal-find-no", () => this.#answer(false));
    on("cal-find-turn", () => this.#listener.change(turned(state.given)));
    const cameras = part<HTMLSelectElement>("cal-find-camera");
    cameras.addEventListener("change", () => void this.#choose(Number(cameras.value)));
  }

  /** Looks for the court that is chosen, or for any. What is changed meanwhile ends it. */
  async find(): Promise<void> {
    const { picture, given, lens } = this.#state;
    if (!picture) return;
    this.stop();
    const run = (this.#running = new AbortController());
    this.#say(`Looking for ${given.court ? `the ${courtInWords(given.court)}` : "a court"}…`);
    this.show();
    try {
      const search = await findCourt(picture, given.court, run.signal, lens.distortion ? ["distortion"] : []);
      await this.#take(search, run);
    } catch (thrown) {
      if (!run.signal.aborted) this.#inVain = `The search failed: ${messageOf(thrown).replace(/\.$/, "")}`;
    } finally {
      if (this.#running === run) this.#end();
    }
  }

  /** Takes what another step has found in the picture. */
  async take(search: CourtSearch): Promise<void> {
    const run = (this.#running = new AbortController());
    try {
      await this.#take(search, run);
    } finally {
      if (this.#running === run) this.#end();
    }
  }

  /** Ends a search, and forgets one that was in vain. */
  stop(): void {
    this.#inVain = "";
    this.#running?.abort();
    this.#end();
  }

  /** Shows what is known of the points now. */
  show(): void {
    const { proposal } = this.#state.given;
    const isPlaced = this.#state.placing !== undefined && !this.#running;
    const find = this.#part<HTMLButtonElement>("cal-find");
    find.textContent = this.#running ? "Stop looking" : "Find the court";
    find.classList.toggle("primary", !isPlaced && !this.#running);
    const isAsked = isPlaced && proposal?.isAsked === true;
    for (const name of ["cal-find-yes", "cal-find-no"]) this.#part(name).hidden = !isAsked;
    this.#part("cal-find-turn").hidden = !(isPlaced && canTurn(this.#state.given));
    const cameras = this.#part<HTMLSelectElement>("cal-find-camera");
    this.#part("cal-find-cameras").hidden = !(isPlaced && (proposal?.cameras.length ?? 0) > 1);
    cameras.replaceChildren(...(proposal?.cameras ?? []).map(({ court, probability }, index) => new Option(`${index + 1}. ${courtInWords(court)}, ${percentOf(probability)}`, String(index))));
    cameras.value = String(proposal?.chosen ?? 0);
    this.#part("cal-find-answers").hidden = !isPlaced;
    this.#part("cal-find-about").dataset.tone = isPlaced && !isAsked ? "good" : "";
    if (this.#running) return;
    if (isPlaced && proposal) this.#say(isAsked ? `Perhaps found: ${proposal.text}. Is this the court?` : `Found: ${proposal.text}. Drag a point if a line is off.`);
    else this.#say(this.#inVain && `${this.#inVain}. Click points of the court instead.`);
  }

  async #take(search: CourtSearch, run: AbortController): Promise<void> {
    const size = this.#listener.size();
    const given = size && (await givenBy(search, size));
    if (run !== this.#running) return;
    // Not before: a change ends a search.
    this.#running = undefined;
    if (given) this.#listener.change(given);
    else this.#inVain = `No court found: ${search.found.reason}`;
    this.show();
    // On a phone, it is below what was pressed.
    this.#part("cal-find-about").scrollIntoView({ block: "nearest" });
  }

  #answer(isCourt: boolean): void {
    const { given } = this.#state;
    if (isCourt && given.proposal) this.#listener.change({ ...given, proposal: { ...given.proposal, isAsked: false } });
    else this.#listener.change({ court: given.court, points: given.points.map(unclicked) });
    this.#listener.answered();
  }

  async #choose(index: number): Promise<void> {
    const { placing, given } = this.#state;
    const size = this.#listener.size();
    if (!given.proposal || !placing || !size) return;
    const other = await givenByOther(given.proposal, index, placing, size);
    // Unless the user went on.
    if (this.#state.given === given) this.#listener.change(other);
  }

  #end(): void {
    this.#running = undefined;
    this.show();
  }

  #say(text: string): void {
    const place = this.#part("cal-find-said");
    if (place.textContent !== text) place.textContent = text;
  }
}
