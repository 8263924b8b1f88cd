/** What the user has given: points, clicks, lens. Kept in this browser; every change can be undone. */
import type { CalibrationPoints, Vector } from "gravisight";
import { get, set } from "idb-keyval";
import type { Pixel } from "../shared/canvas";
import type { Place } from "./court-points";
import { placingOf, type Placing, type Proposal } from "./placed";

export interface Point {
  name: string;
  /** Metres; null where the user has not written it yet. */
  world: [number | null, number | null, number | null];
  click: Pixel | null;
  /** Whether the user said that the picture does not show it. */
  isAbsent?: boolean;
}

export interface Given {
  /** A court's name, or nothing for own points. */
  court: string;
  points: Point[];
  /** Of points that a found camera has placed. */
  placing?: Placing;
  /** What was found, for people. */
  proposal?: Proposal;
}

export interface Lens {
  /** Pixels; null where it is to be estimated. */
  focal: number | null;
  distortion: boolean;
}

interface Kept {
  given: Given;
  lens: Lens;
  pictureName: string;
  pictureOf?: string;
}

const STATE = "calibrate";
const PICTURE = "calibrate picture";
const MOST_UNDONE = 200;
/** Moves of one point within this time are undone together, ms. */
const ONE_MOVE = 1000;

export class State {
  given: Given = { court: "", points: [] };
  lens: Lens = { focal: null, distortion: false };
  picture: Blob | undefined;
  pictureName = "";
  /** The file that it is of: a video's, where it is a frame. */
  pictureOf = "";
  readonly #past: string[] = [];
  #lastMove = { what: "", at: 0 };

  /** Remembers how it is now, before a change; `what` joins moves of one thing. */
  remember(what = ""): void {
    const now = performance.now();
    const goesOn = what !== "" && what === this.#lastMove.what && now - this.#lastMove.at < ONE_MOVE;
    this.#lastMove = { what, at: now };
    if (goesOn) return;
    this.#past.push(JSON.stringify(this.given));
    if (this.#past.length > MOST_UNDONE) this.#past.shift();
  }

  get canUndo(): boolean {
    return this.#past.length > 0;
  }

  undo(): boolean {
    const last = this.#past.pop();
    this.#lastMove.what = "";
    if (last !== undefined) this.given = JSON.parse(last) as Given;
    return last !== undefined;
  }

  /** What holds of points that a found camera has placed. */
  get placing(): Placing | undefined {
    return placingOf(this.given);
  }

  /** Whether a person has yet to say that the court was found. */
  get isAsked(): boolean {
    return this.placing !== undefined && this.given.proposal?.isAsked === true;
  }

  /** Indices of the points that a calibration can use. */
  usable(): number[] {
    return this.given.points.flatMap((point, index) => (point.click && wholeOf(point) ? [index] : []));
  }

  /** The content of a points.json of the usable points. */
  asFile(width: number, height: number): CalibrationPoints {
    const points = this.usable().flatMap((index) => this.given.points[index] ?? []);
    const { court } = this.given;
    const image = points.flatMap((point) => (point.click ? [point.click] : []));
    const names = points.map((point, index) => point.name || `point ${index + 1}`);
    const { focal } = this.lens;
    const known = focal === null ? {} : { intrinsic: [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]] };
    const world = points.map(wholeOf).filter((place) => place !== undefined);
    return { width, height, ...known, image, names, ...(court ? { court, ...this.#placed() } : { world }) };
  }

  /**
   * Points that were placed are calibrated as clicks are, with their own uncertainty: this gives the calibration of `Toolbox.findCourt`
   * again, and goes on when a point is moved, the court is turned or another camera is chosen.
   */
  #placed(): Partial<CalibrationPoints> {
    const { placing } = this;
    if (!placing) return {};
    const { sigmaPx, lines, distortion } = placing;
    return { sigma_px: sigmaPx, ...(lines && { lines }), ...(distortion && { distortion }) };
  }

  async keep(): Promise<void> {
    const kept: Kept = { given: this.given, lens: this.lens, pictureName: this.pictureName, pictureOf: this.pictureOf };
    await set(STATE, kept).catch(() => undefined);
  }

  async keepPicture(): Promise<void> {
    await set(PICTURE, this.picture).catch(() => undefined);
  }

  async restore(): Promise<void> {
    const [kept, picture] = await Promise.all([get<Kept>(STATE), get<Blob>(PICTURE)]).catch(() => [undefined, undefined]);
    if (kept) ({ given: this.given, lens: this.lens, pictureName: this.pictureName, pictureOf: this.pictureOf = kept.pictureName } = kept);
    this.picture = picture;
  }
}

/** A point of which nothing is known in a picture. */
export function unclicked({ name, world }: Point): Point {
  return { name, world, click: null };
}

/** A point's place, where all of it is known. */
export function wholeOf({ world: [x, y, z] }: Point): Vector | undefined {
  return x === null || y === null || z === null ? undefined : [x, y, z];
}

/** The points of a points.json; throws in words. `placesOf` gives a court's points. */
export async function pointsFrom(
  content: unknown,
  name: string,
  size: { width: number; height: number } | undefined,
  placesOf: (court: string) => Promise<Place[]>,
): Promise<{ given: Given; focal: number | null; leftOut: boolean }> {
  const file = (content ?? {}) as Partial<CalibrationPoints>;
  const { image, world, names, court } = file;
  if (!Array.isArray(image) || !image.every(isPixel)) throw new Error(`${name} is not a points.json: it needs \`image\`, a list of [x, y] in pixels.`);
  if (size && (file.width !== size.width || file.height !== size.height)) {
    throw new Error(`${name} is for a picture of ${file.width} × ${file.height} pixels, but this one has ${size.width} × ${size.height}.`);
  }
  const focal = file.intrinsic?.[0]?.[0] ?? null;
  const isCentred = (axis: 0 | 1, side = 0) => Math.abs((file.intrinsic?.[axis]?.[2] ?? 0) - (side - 1) / 2) < 1e-3;
  // The step knows lenses with the picture's middle in their middle.
  const leftOut = file.distortion !== undefined || (focal !== null && !(isCentred(0, file.width) && isCentred(1, file.height)));
  if (court !== undefined) {
    const places = await placesOf(court);
    const unknown = (names ?? []).find((each) => !places.some(([known]) => known === each));
    if (unknown !== undefined) throw new Error(`${name} has a point “${unknown}” that the court ${court} does not have.`);
    const clickOf = (each: string) => image[(names ?? []).indexOf(each)] ?? null;
    const points = places.map(([each, place]) => ({ name: each, world: place, click: clickOf(each) }));
    const { sigma_px: sigmaPx, lines, distortion } = file;
    const placing = sigmaPx === undefined ? {} : { placing: { sigmaPx, lines, distortion, at: points.map(({ click }) => click) } };
    return { given: { court, points, ...placing }, focal, leftOut: leftOut && sigmaPx === undefined };
  }
  if (!Array.isArray(world) || world.length !== image.length || !world.every(isVector)) {
    throw new Error(`${name} needs as many \`world\` points ([x, y, z] in metres) as \`image\` points.`);
  }
  const points = world.map((place, index): Point => ({ name: names?.[index] ?? `point ${index + 1}`, world: place, click: image[index] ?? null }));
  return { given: { court: "", points }, focal, leftOut };
}

function isNumbers(value: unknown, count: number): boolean {
  return Array.isArray(value) && value.length === count && value.every((one) => Number.isFinite(one));
}
const isPixel = (value: unknown): value is Pixel => isNumbers(value, 2);
const isVector = (value: unknown): value is Vector => isNumbers(value, 3);
