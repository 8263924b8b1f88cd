/** The numbers. Each is a `data` element that also holds its full value. */
import type { Card, Localisation } from "gravisight";
import { element, make } from "../dom";
import { placeOf, type Place } from "./place";
import type { Subject } from "./subject";

const AXES = ["x", "y", "z"] as const;
const NOTHING = "–";
const HEADING = "Position in the world, in metres";
const HEADINGS = {
  unfound: "The likeliest detection, in the world, in metres",
  circle: "Position from your circle, in the world, in metres",
  chosen: "Position that you chose, in the world, in metres",
} as const;

export class ResultPanel {
  readonly #heading = make("h2", { text: HEADING, part: "result-heading" });
  readonly #missing = make("p", { class: "callout missing", part: "no-ball" });
  readonly #world = AXES.map((axis) => number(`world-${axis}`));
  readonly #camera = AXES.map((axis) => number(`camera-${axis}`));
  readonly #image = number("image-xy");
  readonly #sigma = number("sigma");
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
    this.#missing.dataset.tone = "bad";
    this.#missing.setAttribute("role", "status");
    element("result").prepend(
      this.#missing,
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
        row("Uncertainty (1-σ)", this.#sigma, "m"),
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
    this.#heading.textContent = result.ballFound ? HEADING : HEADINGS.unfound;
    element("result").classList.toggle("unfound", !result.ballFound);
    this.#missing.textContent = result.ballFound ? "" : "No ball found. Circle the ball in the picture, or choose one of the likeliest positions.";
    this.#numbers(placeOf(result, "the network"), subject);
    set(this.#time, [result.milliseconds], result.milliseconds < 10 ? 1 : 0);
    const notes = [...result.notes, ...(subject.note ? [subject.note] : [])];
    // It has learned the depths of its scenes, and reads no sizes.
    if (subject.note && from !== "size") notes.push(`The model ${name} does not know this scene: choose “Any ball”.`);
    this.#notes.replaceChildren(...notes.map((text) => make("li", { text })));
  }

  /** A position that a person has pointed at. */
  showPlace(place: Place, subject: Subject): void {
    this.#heading.textContent = place.circle ? HEADINGS.circle : HEADINGS.chosen;
    element("result").classList.remove("unfound");
    this.#missing.textContent = "";
    this.#numbers(place, subject);
    set(this.#time, [], 0);
    this.#notes.replaceChildren(...(subject.note ? [make("li", { text: subject.note })] : []));
  }

  #numbers({ world, camera, image, depth, depthSigma, sigma, confidence, dtg }: Place, subject: Subject): void {
    for (const axis of AXES.keys()) {
      set(this.#world[axis]!, [world[axis]!], 3);
      set(this.#camera[axis]!, camera ? [camera[axis]!] : [], 3);
    }
    set(this.#image, image, 1);
    set(this.#sigma, sigma === null ? [] : [sigma], 3);
    set(this.#depth, [depth], 3);
    if (depthSigma !== null) this.#depth.textContent += ` ± ${depthSigma.toFixed(3)}`;
    set(this.#confidence, confidence === undefined ? [] : [confidence], 3);
    set(this.#true, subject.truth?.world ?? [], 3);
    set(this.#error, dtg === undefined ? [] : [100 * dtg], 1);
    for (const sampleRow of this.#sampleRows) sampleRow.hidden = !subject.truth;
    this.#otherRow.hidden = true;
  }

  /** The same picture's error by the other model. */
  showOther(model: string, { dtg }: Localisation): void {
    this.#otherName.textContent = `Error of ${model}`;
    set(this.#other, dtg === undefined ? [] : [100 * dtg], 1);
    this.#otherRow.hidden = dtg === undefined;
  }

  clear(): void {
    const all = [...this.#world, ...this.#camera, this.#image, this.#sigma, this.#depth, this.#confidence, this.#time, this.#true, this.#error];
    for (const each of all) set(each, [], 0);
    for (const sampleRow of this.#sampleRows) sampleRow.hidden = true;
    this.#otherRow.hidden = true;
    this.#missing.textContent = "";
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
