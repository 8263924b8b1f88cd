/** What the user does next, as text. */
import { make } from "../dom";
import type { Clicks } from "./clicks";
import { wholeOf, type Point } from "./state";

/** What a click does now. */
export function nextStep(points: Point[], { current, moved, size }: Clicks, isPlaced: boolean): Node[] {
  const next = points[current];
  if (!size) return [];
  if (!next) return [make("span", { text: "Now choose a court, or add points of your own." })];
  const nodes: Node[] = [make("span", { text: next.click ? "A click moves " : isPlaced ? "A click adds " : "Next click: " }), make("strong", { text: nameOf(points, current) })];
  if (moved !== undefined && moved !== current) nodes.push(make("span", { text: ` · arrow keys move ${nameOf(points, moved)}` }));
  return nodes;
}

/** What is missing for a camera, in full and in short. */
export function stillNeeded(points: Point[], hasPicture: boolean, more: number): [full: string, short: string] {
  if (!hasPicture) return ["Choose a picture, choose points, then click them: the camera appears here.", ""];
  const unplaced = points.filter((point) => point.click && !wholeOf(point)).length;
  const missing = unplaced > 0 ? ` ${unplaced === 1 ? "One clicked point has" : `${unplaced} clicked points have`} no coordinates yet.` : "";
  const needed = `${more} more ${more === 1 ? "point" : "points"} to click`;
  return [`${needed}: four are enough if all lie in one plane, such as a floor; otherwise six.${missing}`, `${needed}.`];
}

export function nameOf(points: Point[], index: number): string {
  return `${index + 1}. ${points[index]?.name || "point"}`;
}
