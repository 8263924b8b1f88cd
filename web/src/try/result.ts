/** The numbers. Each is a `data` element that also holds its full value. */
import type { Card, Localisation } from "gravisight";
import { element, make } from "../dom";
import type { Subject } from "./subject";

const AXES = ["x", "y", "z"] as const;
const NOTHING = "–";
const HEADING = "Position in the world, in metres";
const UNFOUND = "No ball found. The likeliest detection, in the world, in metres";

export class ResultPanel {
  readonly #heading = make("h2", { text: HEADING });
  readonly #world = AXES.map((axis) => number(`world-${axis}`));
  readonly #camera = AXES.map((axis) => number(`camera-${axis}`));
  readonly #image = number("image-xy");
  readonly #depth = number("depth");
  readonly #confidence = number("confidence");
  readonly #time = number("time");
  readonly #true = number("true-xyz");
  readonly #error = number("error-cm");
  readonly #other = number("other-error-cm");
  readonly #otherName = make("dt", { text: "" });
  readonly #otherRow = make("div", { class: "row" }, this.#otherName, make("dd", {}, this.#other, make("span", { class: "unit", text: "cm" })));
  readonly #device = make("span", { text: NOTHING });
  readonly #reason = make("small", { part: "device-reason" });
  readonly #notes = make("ul", { class: "notes", part: "notes" });
  readonly #sampleRows: HTMLElement[];

  constructor() {
    const truth = row("True position", this.#true, "m");
    const error = row("Error", this.#error, "cm");
    error.classList.add("error");
    this.#sampleRows = [error, truth];
    const device = make("div", { class: "row" });
    device.append(make("dt", { text: "Device" }), make("dd", { part: "device" }, this.#device, this.#reason));
    element("result").append(
      this.#heading,
      vector("vector large", this.#world),
      make("h2", { text: "In the camera’s frame, in metres" }),
      vector("vector", this.#camera),
      make(
        "dl",
        {},
        error,
        this.#otherRow,
        truth,
        row("Depth", this.#depth, "m"),
        row("In the picture", this.#image, "px"),
        row("Confidence", this.#confidence, ""),
        row("Time", this.#time, "ms"),
        device,
      ),
      this.#notes,
    );
    this.clear();
  }

  showDevice(name: string, reason: string): void {
    this.#device.textContent = name;
    this.#reason.textContent = reason;
  }

  show(result: Localisation, subject: Subject, { name, depth_from: from }: Card): void {
    this.#heading.textContent = result.ballFound ? HEADING : UNFOUND;
    element("result").classList.toggle("unfound", !result.ballFound);
    result.world.forEach((value, axis) => set(this.#world[axis]!, [value], 3));
    result.camera.forEach((value, axis) => set(this.#camera[axis]!, [value], 3));
    set(this.#image, result.image, 1);
    set(this.#depth, [result.depth], 3);
    if (result.depthSigma !== null) this.#depth.textContent += ` ± ${result.depthSigma.toFixed(3)}`;
    set(this.#confidence, [result.confidence], 3);
    set(this.#time, [result.milliseconds], result.milliseconds < 10 ? 1 : 0);
    set(this.#true, subject.truth?.world ?? [], 3);
    set(this.#error, result.dtg === undefined ? [] : [100 * result.dtg], 1);
    for (const sampleRow of this.#sampleRows) sampleRow.hidden = !subject.truth;
    this.#otherRow.hidden = true;
    const notes = [...result.notes, ...(subject.note ? [subject.note] : [])];
    // It has learned the depths of its scenes, and reads no sizes.
    if (subject.note && from !== "size") notes.push(`The model ${name} does not know this scene: choose “Any ball”.`);
    this.#notes.replaceChildren(...notes.map((text) => make("li", { text })));
  }

  /** The same picture's error by the other model. */
  showOther(model: string, { dtg }: Localisation): void {
    this.#otherName.textContent = `Error of ${model}`;
    set(this.#other, dtg === undefined ? [] : [100 * dtg], 1);
    this.#otherRow.hidden = dtg === undefined;
  }

  clear(): void {
    const all = [...this.#world, ...this.#camera, this.#image, this.#depth, this.#confidence, this.#time, this.#true, this.#error];
    for (const each of all) set(each, [], 0);
    for (const sampleRow of this.#sampleRows) sampleRow.hidden = true;
    this.#otherRow.hidden = true;
    this.#heading.textContent = HEADING;
    element("result").classList.remove("unfound");
    this.#notes.replaceChildren();
  }
}

function number(name: string): HTMLDataElement {
  return make("data", { part: name });
}

function set(target: HTMLDataElement, values: readonly number[], digits: number): void {
  target.value = values.join(" ");
  target.textContent = values.map((value) => value.toFixed(digits).replace("-", "−")).join(", ") || NOTHING;
}

function vector(className: string, values: HTMLDataElement[]): HTMLElement {
  const parts = values.map((value, axis) => make("div", {}, make("span", { class: "axis", text: AXES[axis]! }), value));
  return make("div", { class: className }, ...parts);
}

function row(name: string, value: HTMLElement, unit: string): HTMLElement {
  const content = make("dd", {}, value);
  if (unit) content.append(make("span", { class: "unit", text: unit }));
  return make("div", { class: "row" }, make("dt", { text: name }), content);
}
