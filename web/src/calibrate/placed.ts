/** Points that a camera has placed which was found without clicks: they count as clicks, but less exact ones. */
import type { Camera, CourtLine, CourtSearch, OtherCourt } from "gravisight";
import type { Pixel } from "../shared/canvas";
import { tools } from "../shared/core";
import { courtInWords, courtWithPoints, foundInWords, percentOf } from "../shared/find-court";
import { courtPoints } from "./court-points";
import type { Given, Point } from "./state";

/** What a calibration has to know of them. */
export interface Placing {
  /** 1-σ of the points, pixels. */
  sigmaPx: number;
  /** The lines that are painted, where they are not all of the court's. */
  lines: CourtLine[] | undefined;
  /** The lens that was found with the camera: a start, which is estimated. */
  distortion: Camera["distortion"] | undefined;
  /** Where each point was placed; one that was moved since is a click. */
  at: (Pixel | null)[];
}

/** What a person has to know of them. */
export interface Proposal {
  /** The cameras that fit, the likeliest first, and which of them placed the points. */
  cameras: OtherCourt[];
  chosen: number;
  /** About the chosen one. */
  text: string;
  /** Whether a person has yet to say that this is the court. */
  isAsked: boolean;
}

/** Coordinates closer than this are the same, m. */
const SAME = 1e-6;

/**
 * The points where the camera of a search that found a court puts them: that camera, not the refined one. From them the calibration comes
 * to the refined one again, as the search did, which is simpler than to keep it beside them until a point is moved.
 */
export async function givenBy({ found }: CourtSearch, size: { width: number; height: number }): Promise<Given | undefined> {
  const { camera: first, court, probability, verdict } = found;
  if (!first) return undefined;
  const cameras = [{ court, probability, camera: first }, ...found.others];
  const proposal = { cameras, chosen: 0, text: foundInWords(found), isAsked: verdict !== "sure" };
  return placedBy(proposal, { sigmaPx: found.sigmaPx, lines: found.lines.map(({ line }) => line), distortion: first.distortion }, size);
}

/** The points where another of the cameras puts them. */
export function givenByOther({ cameras }: Proposal, chosen: number, { sigmaPx, lines }: Placing, size: { width: number; height: number }): Promise<Given> {
  const other = cameras[chosen];
  const isSameCourt = other?.court === cameras[0]?.court;
  const text = other ? `${courtInWords(other.court)}, ${percentOf(other.probability)} probable` : "";
  const proposal = { cameras, chosen, text, isAsked: true };
  return placedBy(proposal, { sigmaPx, lines: isSameCourt ? lines : undefined, distortion: other?.camera.distortion }, size);
}

async function placedBy(proposal: Proposal, placing: Omit<Placing, "at">, { width, height }: { width: number; height: number }): Promise<Given> {
  const { court, camera } = proposal.cameras[proposal.chosen]!;
  const places = await courtPoints(courtWithPoints(court));
  const images = await (await tools()).project(camera, places.map(([, world]) => world));
  const isShown = ([x, y]: Pixel) => x >= 0 && y >= 0 && x < width && y < height;
  const at = images.map((image) => (image && isShown(image) ? image : null));
  const points = places.map(([name, world], index): Point => ({ name, world, click: at[index] ?? null }));
  return { court: courtWithPoints(court), points, placing: { ...placing, at }, proposal };
}

/** Of each point the one that a half-turn of the court puts in its place; undefined where the court is not symmetric. */
function partners(points: Point[]): number[] | undefined {
  const isOpposite = ([a, b, c]: Point["world"], [x, y, z]: Point["world"]) =>
    [a, b, c, x, y, z].every((value) => value !== null) && [a! + x!, b! + y!, c! - z!].every((off) => Math.abs(off) < SAME);
  const found = points.map(({ world }) => points.findIndex((other) => isOpposite(world, other.world)));
  return found.includes(-1) ? undefined : found;
}

/** Whether the court looks the same from its other end. */
export function canTurn(given: Given): boolean {
  return given.placing !== undefined && partners(given.points) !== undefined;
}

/** The same places in the picture, named as from the other end: x and y change their signs; distances stay. */
export function turned(given: Given): Given {
  const { points, placing } = given;
  const partner = partners(points);
  if (!partner) return given;
  const of = <T>(list: T[]) => partner.map((index) => list[index] as T);
  const clicks = of(points.map(({ click }) => click));
  const absent = of(points.map(({ isAbsent }) => isAbsent === true));
  return {
    ...given,
    points: points.map(({ name, world }, index) => ({ name, world, click: clicks[index] ?? null, ...(absent[index] && { isAbsent: true }) })),
    ...(placing && { placing: { ...placing, at: of(placing.at) } }),
  };
}

/** What holds of the points that are still where a camera placed them; undefined where there are none. */
export function placingOf({ points, placing }: Given): Placing | undefined {
  const isThere = ({ click }: Point, index: number) => click !== null && click[0] === placing?.at[index]?.[0] && click[1] === placing.at[index][1];
  return points.some(isThere) ? placing : undefined;
}
