/** The picture that was looked at last, with the ball's ring and the network's maps over it. */
import type { Localisation, Region } from "gravisight";
import { contextOf, make } from "../dom";
import { overlayOf, type Pixel } from "./canvas";
import { drawMap, mapOf, type ColouredMap, type Layer } from "./maps";
import { drawBox, drawCross, drawFound, drawNumbered, drawTrail, drawTruth } from "./marks";
import { ScaleBar } from "./scale";

/** No picture is kept larger than this: no screen shows more. In pixels. */
const LARGEST_SIDE = 1600;
/** Of a ring that is not to be trusted. */
const DIM = 0.4;

export interface Shown {
  layer: Layer;
  /** Whether the position is to be trusted. */
  sure?: boolean;
  truth?: Pixel | undefined;
  /** Where the ball was shortly before, in order; the last one is where it is now. */
  trail?: Pixel[];
  /** Places to choose from, in order. */
  numbered?: readonly Pixel[];
  /** The part of the picture that was searched. */
  region?: Region | undefined;
}

export class Overlay {
  readonly #frame: HTMLElement;
  readonly #picture: HTMLCanvasElement;
  readonly #overlay: HTMLCanvasElement;
  readonly #scale: ScaleBar;
  /** The picture that is being looked at: shown together with what is found in it. */
  readonly #next = make("canvas");
  #size = { width: 1, height: 1 };
  #ring: ({ at: Pixel; sure: boolean } & Omit<Shown, "layer" | "sure">) | undefined;
  #map: ColouredMap | undefined;
  #trail: Pixel[] = [];
  #cross: Pixel | undefined;
  #opacity = 0.7;

  constructor(frame: HTMLElement, picture: HTMLCanvasElement, overlay: HTMLCanvasElement, scale: HTMLElement) {
    this.#frame = frame;
    this.#picture = picture;
    this.#overlay = overlay;
    this.#scale = new ScaleBar(scale);
    new ResizeObserver(() => this.#draw()).observe(frame);
  }

  setSize(width: number, height: number): void {
    this.#size = { width, height };
    const shrink = Math.min(1, LARGEST_SIDE / Math.max(width, height, 1));
    for (const canvas of [this.#picture, this.#next]) {
      canvas.width = Math.max(1, Math.round(width * shrink));
      canvas.height = Math.max(1, Math.round(height * shrink));
    }
    this.#frame.style.setProperty("--aspect", String(width / height));
    this.clear("No position yet");
  }

  /** Of the maps. */
  setOpacity(opacity: number): void {
    this.#opacity = opacity;
    if (this.#map) this.#draw();
  }

  /** Keeps a picture until {@link show}. */
  hold(image: CanvasImageSource): void {
    contextOf(this.#next).drawImage(image, 0, 0, this.#next.width, this.#next.height);
  }

  /** Shows a picture about which nothing is known. */
  showPlain(image: CanvasImageSource, label: string, trail: Pixel[] = []): void {
    this.hold(image);
    this.#flip();
    this.clear(label, trail);
  }

  /** A cross that a person moves; none where `at` is undefined. */
  aim(at: Pixel | undefined): void {
    if (!at && !this.#cross) return;
    this.#cross = at;
    this.#draw();
  }

  /** Shows the picture that is held, and what was found in it. */
  show(found: { image: Pixel; depth: number | null } & Omit<Partial<Localisation>, "depth" | "world">, { layer, sure = true, trail = [], ...marks }: Shown): void {
    this.#flip();
    this.#trail = trail;
    this.#ring = { at: found.image, sure, ...marks };
    this.#map = mapOf(found, layer);
    const [u, v] = found.image.map((x) => x.toFixed(0));
    const where = `the ball at pixel ${u}, ${v}${found.depth === null ? "" : `, ${found.depth.toFixed(2)} metres from the camera`}`;
    this.#overlay.setAttribute("aria-label", sure ? `Found: ${where}` : `Not sure: perhaps ${where}`);
    this.#draw();
  }

  clear(label: string, trail: Pixel[] = []): void {
    this.#trail = trail;
    this.#ring = this.#map = undefined;
    this.#overlay.setAttribute("aria-label", label);
    this.#draw();
  }

  #flip(): void {
    contextOf(this.#picture).drawImage(this.#next, 0, 0);
  }

  #draw(): void {
    const { context, width, height, toCanvas } = overlayOf(this.#overlay, this.#size);
    this.#scale.show(this.#map?.scale ?? null);
    if (this.#map) drawMap(context, this.#map, width, height, this.#opacity);
    drawTrail(context, this.#trail.map(toCanvas));
    if (this.#cross) drawCross(context, toCanvas(this.#cross));
    if (!this.#ring) return;
    const { at, sure, truth, numbered = [], region } = this.#ring;
    if (region) {
      const { left, top } = region;
      drawBox(context, toCanvas([left - 0.5, top - 0.5]), toCanvas([left + region.width - 0.5, top + region.height - 0.5]));
    }
    // A single one is where the ring is.
    if (numbered.length > 1) drawNumbered(context, numbered.map(toCanvas));
    context.globalAlpha = sure ? 1 : DIM;
    drawFound(context, toCanvas(at));
    if (truth) drawTruth(context, toCanvas(truth));
  }
}
