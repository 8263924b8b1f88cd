/** The sample picture, and corners of its boxes that can be clicked. */
import { fetchOk } from "../shared/files";
import type { Point } from "./state";

const FOLDER = `${import.meta.env.BASE_URL}samples/`;

/** Of the first sample's scene, metres. */
const CORNERS: [string, [number, number, number]][] = [
  ["yellow box, top, left corner", [-1.5, 0.2, 0.4]],
  ["yellow box, top, far corner", [0.5, 0.2, 0.4]],
  ["yellow box, top, right corner", [0.5, -1.2, 0.4]],
  ["yellow box, top, near corner", [-1.5, -1.2, 0.4]],
  ["blue box, foot, left corner", [0.6444, 2.6243, 0]],
  ["blue box, foot, right corner", [2.6243, 0.6444, 0]],
  ["blue box, top, left corner", [0.6444, 2.6243, 1.3]],
  ["blue box, top, right corner", [2.6243, 0.6444, 1.3]],
  ["green box, top, far corner", [-1.8686, 0.5, 0.8]],
  ["green box, top, near corner", [-3, -0.6314, 0.8]],
];

export async function takeSample(): Promise<{ picture: Blob; name: string; points: Point[] }> {
  const samples = (await (await fetchOk(`${FOLDER}samples.json`)).json()) as { name: string; file: string }[];
  const sample = samples[0];
  if (!sample) throw new Error("This page has no samples.");
  const picture = await (await fetchOk(FOLDER + sample.file)).blob();
  return { picture, name: sample.name, points: CORNERS.map(([name, world]) => ({ name, world, click: null })) };
}
