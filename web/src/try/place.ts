import type { BallAt, DrawnCircle, Localisation, Vector } from "gravisight";

/** A position, and who found it. */
export interface Place {
  /** In words. */
  how: string;
  world: Vector;
  /** In the camera's frame, where it is known. */
  camera?: Vector;
  image: [number, number];
  depth: number;
  depthSigma: number | null;
  /** 1-σ of the position, metres; null where it is not known. */
  sigma: number | null;
  covariance?: Localisation["covariance"];
  /** Of the network. */
  confidence?: number;
  /** Distance to the truth, metres. */
  dtg?: number;
  /** That somebody drew. */
  circle?: DrawnCircle;
}

/** What the network found. */
export function placeOf({ world, camera, image, depth, depthSigma, covariance, confidence, dtg }: Localisation, how: string): Place {
  const sigma = covariance ? Math.sqrt(covariance.reduce((sum, row, axis) => sum + (row[axis] ?? 0), 0)) : null;
  return { how, world, camera, image, depth, depthSigma, sigma, covariance, confidence, ...(dtg !== undefined && { dtg }) };
}

/** One of the likeliest places, by its index. */
export function placeOfCandidate(result: Localisation, index: number, truth: Vector | undefined): Place | undefined {
  const found = result.candidates?.[index];
  if (!found) return undefined;
  const { world, image, depth, depthSigma, confidence } = found;
  return { how: `the network’s candidate ${index + 1}, chosen by you`, world, image, depth, depthSigma, sigma: null, confidence, ...distance(world, truth) };
}

/** What is in a circle. */
export function placeOfCircle(found: BallAt, circle: DrawnCircle, truth: Vector | undefined): Place {
  const { world, camera, image, depth, depthSigma, covariance, sigma } = found;
  return { how: "your circle", world, camera, image, depth, depthSigma, covariance, sigma, circle, ...distance(world, truth) };
}

function distance(world: Vector, truth: Vector | undefined): { dtg?: number } {
  return truth ? { dtg: Math.hypot(...world.map((value, axis) => value - truth[axis]!)) } : {};
}
