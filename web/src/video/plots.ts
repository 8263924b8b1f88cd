/** The two plots: where the ball is, and how fast. */
import { Chart, pictureOf, type Series } from "../shared/chart";
import type { Curve, FrameDetection } from "./detections";
import type { Units } from "./units";

/** Of a source without an end, in seconds: the last ones. */
const LIVE_WINDOW = 20;
/** A video up to this long is plotted on its whole length from the start, in seconds. */
const SHORT = 12;

const AXES = ["x", "y", "z"];
const PIXELS = ["across", "down"];
const TIME = "time (s)";

export class Plots {
  readonly #position: Chart;
  readonly #speed: Chart;
  readonly #pixels: Chart;
  readonly #positionPlace: HTMLElement;
  readonly #speedPlace: HTMLElement;
  readonly #pixelsPlace: HTMLElement;

  /** `pick` hears the time (s) that a click chooses. */
  constructor(position: HTMLElement, speed: HTMLElement, pixels: HTMLElement, pick: (seconds: number) => void) {
    this.#position = new Chart(position, "video-chart-position");
    this.#pixels = new Chart(pixels, "video-chart-pixels");
    this.#positionPlace = position;
    this.#pixelsPlace = pixels;
    this.#speed = new Chart(speed, "video-chart-speed");
    this.#speedPlace = speed;
    for (const chart of [this.#position, this.#speed, this.#pixels]) chart.onPick = pick;
  }

  /** Marks the moment (s) that the video shows. */
  showNow(seconds: number): void {
    for (const chart of [this.#position, this.#speed, this.#pixels]) chart.showNow(seconds);
  }

  show(all: FrameDetection[], fit: Curve | undefined, { threshold, durationMs, units }: { threshold: number; durationMs: number; units: Units }): void {
    const { length, speed: speedUnit } = units;
    const last = all.at(-1)?.filmed ?? 0;
    const live = !Number.isFinite(durationMs);
    const from = live ? Math.max(0, last - LIVE_WINDOW) : durationMs / 1000 <= SHORT ? 0 : (all[0]?.filmed ?? 0);
    const to = !live && durationMs / 1000 <= SHORT ? durationMs / 1000 || 1 : Math.max(last, from + 1);
    const shown = all.filter(({ filmed }) => filmed >= from);
    // What is not explained is no trajectory.
    const frames = (fit?.frames ?? []).filter(({ time, explained }) => time >= from && explained);
    const marks = [...(fit?.impacts ?? []), ...(fit?.hits ?? [])].map(({ time }) => time).filter((time) => time >= from);
    // Of a track without a camera there are pixels alone.
    const flat = fit?.flat ?? false;
    const pixels = PIXELS.map((name, axis): Series => {
      const dots = (isSure: boolean) => shown.flatMap(({ filmed, image, confidence }): [number, number][] => (confidence >= threshold === isSure ? [[filmed, image[axis] ?? 0]] : []));
      return { name, colour: `--axis-${AXES[axis] ?? "x"}`, dots: dots(true), faint: dots(false) };
    });
    const series = AXES.map((name, axis): Series => {
      const dots = (isSure: boolean) =>
        shown.flatMap(({ filmed, world, confidence, explained }): [number, number][] => (world && (confidence >= threshold && explained !== false) === isSure ? [[filmed, length.per * (world[axis] ?? 0)]] : []));
      const line = frames.map(({ time, world }): [number, number] => [time, length.per * (world[axis] ?? 0)]);
      return { name, colour: `--axis-${name}`, dots: dots(true), faint: dots(false), line };
    });
    this.#positionPlace.hidden = flat;
    this.#pixelsPlace.hidden = !flat;
    if (flat) this.#pixels.show({ y: "In the picture (px)", x: TIME, series: pixels, from, to });
    else this.#position.show({ y: `Position (${length.name})`, x: TIME, series, marks, from, to });
    this.#speedPlace.hidden = !fit || frames.length === 0;
    const line = frames.map(({ time, speed }): [number, number] => [time, speedUnit.per * speed]);
    if (!this.#speedPlace.hidden) this.#speed.show({ y: `Speed of the fit (${speedUnit.name})`, x: TIME, series: [{ name: "", colour: "--accent", line }], marks, from, to });
  }

  picture(): Promise<Blob> {
    return pictureOf([this.#positionPlace.hidden ? this.#pixels : this.#position, ...(this.#speedPlace.hidden ? [] : [this.#speed])]);
  }
}
