import { GravisightError } from "./error.js";
import { workingFolder } from "./node.js";

/** `url` in full. Relative ones start at the page; in a Worker at its script; in Node.js at the working folder. */
export function absoluteUrl(url: string | URL): string {
  try {
    return new URL(url, globalThis.document?.baseURI ?? globalThis.location?.href ?? workingFolder()).href;
  } catch {
    throw new GravisightError("model-url", `"${String(url)}" is not a URL.`);
  }
}
