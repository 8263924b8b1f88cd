/** The real clip that comes with the page, and one of its frames. */
import type { Camera } from "gravisight";
import { fetchOk } from "./files";

const FOLDER = `${import.meta.env.BASE_URL}real/`;

/** As in `public/real/real.json`. */
export interface Real {
  name: string;
  /** Files of that folder: a frame, and the whole clip. */
  picture: string;
  clip: string;
  /** Assumed: nobody calibrated it. */
  camera: Camera;
  /** m. */
  ball: { radius: number };
  /** What was assumed, in words. */
  note: string;
  source: string;
}

export async function real(): Promise<Real> {
  return (await (await fetchOk(`${FOLDER}real.json`)).json()) as Real;
}

/** The address of one of its files. */
export function realUrl(file: string): string {
  return FOLDER + file;
}
