/** A court's points, in the order in which they are best clicked. */
import type { Vector } from "gravisight";
import { tools } from "../shared/core";

export type Place = [name: string, world: Vector];

/** The points of a court, the corners first. */
export async function courtPoints(court: string): Promise<Place[]> {
  return cornersFirst(Object.entries((await (await tools()).court(court)).points));
}

/**
 * A court's origin is its middle, so a corner at (x, y) spans a rectangle of |x · y| about it.
 * The larger the rectangle, the earlier the point: the outer corners, then those of the inner rectangles.
 * Points on an axis span none: the farther from the middle, the earlier. Points off the level of the lines come last.
 */
function cornersFirst(places: Place[]): Place[] {
  const level = levelOf(places.map(([, world]) => world));
  const isRaised = ([, [, , z]]: Place) => Number(z !== level);
  const area = ([, [x, y]]: Place) => Math.abs(x * y);
  const far = ([, [x, y]]: Place) => Math.hypot(x, y);
  // Stable: what is equally far stays in the core's order.
  return [...places].sort((a, b) => isRaised(a) - isRaised(b) || area(b) - area(a) || far(b) - far(a));
}

/** The height at which most points lie: the ground, or a table's top. */
export function levelOf(places: Vector[]): number {
  const many = new Map<number, number>();
  for (const [, , z] of places) many.set(z, (many.get(z) ?? 0) + 1);
  return [...many].sort(([, a], [, b]) => b - a)[0]?.[0] ?? 0;
}
