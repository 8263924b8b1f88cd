/** Files: the user's, the server's, and those that the page saves. */
import { messageOf } from "../dom";
import { pictureFile } from "./canvas";

export function isJson(file: File): boolean {
  return file.type === "application/json" || file.name.toLowerCase().endsWith(".json");
}

/** What to do with another tool's camera file (OpenCV, ROS, Kalibr, COLMAP, Tsai), if one is among the files. */
export function otherToolsCamera(files: File[]): string | undefined {
  const file = files.find(({ name }) => /\.(ya?ml|xml|npz)$|^(cameras|images)\.txt$/i.test(name));
  if (!file) return undefined;
  return `${file.name}: this page reads camera.json. If this is another tool’s camera, convert it with the command gravisight camera import "${file.name}" --to camera.json, and drop the result.`;
}

export function isVideo(file: File): boolean {
  return file.type.startsWith("video/") || /\.(mp4|m4v|mov|webm|mkv|avi|ogv)$/i.test(file.name);
}

/** Picture files that the core decodes itself, as the command does. */
const DECODED = ["image/png", "image/jpeg", "image/webp"];

/** A picture as the core takes it: as it is, or, of another kind that this browser can show (AVIF, GIF, BMP, HEIC), as PNG. */
export async function readablePicture(file: File): Promise<Blob> {
  if (DECODED.includes(file.type)) return file;
  const bitmap = await createImageBitmap(file, { colorSpaceConversion: "none" }).catch(() => undefined);
  // The core's own words are better than the browser's.
  if (!bitmap) return file;
  try {
    return await pictureFile(bitmap, bitmap);
  } finally {
    bitmap.close();
  }
}

/** What a JSON file holds; throws in words. */
export async function readJson(file: File): Promise<unknown> {
  const text = await file.text().catch((thrown: unknown) => {
    throw new Error(`${file.name} could not be read: ${messageOf(thrown)}.`);
  });
  try {
    return JSON.parse(text);
  } catch (thrown) {
    const hint = /\b(NaN|Infinity)\b/.test(text) ? " NaN and infinity are not numbers in JSON, and no camera has them." : "";
    throw new Error(`${file.name} is not JSON: ${messageOf(thrown)}.${hint}`);
  }
}

/** Fetches; throws in words. */
export async function fetchOk(url: string): Promise<Response> {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`Could not fetch ${url}: the server answered ${response.status}.`);
  return response;
}

/** Saves a file that the page has made. */
export function save(name: string, content: Blob | string, type = "application/json"): void {
  const blob = typeof content === "string" ? new Blob([content], { type }) : content;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
