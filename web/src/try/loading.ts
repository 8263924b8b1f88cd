/** The state by name, and the progress bar with bytes. */
import type { Progress } from "gravisight";
import { element } from "../dom";

type State = "loading" | "warming up" | "ready" | "localising" | "not loaded";

const NAMES = { wasm: "core", weights: "weights" } as const;
const MEGABYTE = 1e6;

export class LoadingLine {
  readonly #status = element("status");
  readonly #line = element("status-line");
  readonly #box = element("loading");
  readonly #bar = element<HTMLProgressElement>("progress");
  readonly #message = element("progress-words");
  #stages = new Map<"wasm" | "weights", { loaded: number; total: number | null }>();

  set(state: State): void {
    if (this.#status.textContent !== state) this.#status.textContent = state;
    this.#line.dataset.state = state;
    this.#box.hidden = state !== "loading" && state !== "warming up";
    if (state !== "loading") this.#stages.clear();
    if (state === "loading" && this.#stages.size === 0) this.#show(null, "checking the device");
    if (state === "warming up") this.#show(null, "first pass through the network");
  }

  progress({ stage, loaded, total }: Progress): void {
    if (stage !== "wasm" && stage !== "weights") return this.set("warming up");
    this.#stages.set(stage, { loaded, total });
    const stages = [...this.#stages.values()];
    const totals = stages.map((each) => each.total);
    const known = totals.every((each) => each !== null);
    const sum = (values: (number | null)[]) => values.reduce<number>((a, b) => a + (b ?? 0), 0);
    const fraction = known && this.#stages.size === 2 ? sum(stages.map((each) => each.loaded)) / sum(totals) : null;
    this.#show(fraction, [...this.#stages].map(([name, each]) => `${NAMES[name]} ${bytes(each)}`).join(", "));
    this.set("loading");
  }

  #show(fraction: number | null, message: string): void {
    if (fraction === null) this.#bar.removeAttribute("value");
    else this.#bar.value = fraction;
    this.#message.textContent = message;
  }
}

function bytes({ loaded, total }: { loaded: number; total: number | null }): string {
  const megabytes = (count: number) => (count / MEGABYTE).toFixed(1);
  return total === null ? `${megabytes(loaded)} MB` : `${megabytes(loaded)} of ${megabytes(total)} MB`;
}
