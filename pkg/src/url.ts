import { GravisightError } from "./error.js";
import { workingFolder } from "./node.js";

/** `url` in full. Relative ones start at the page; in a Worker at its script; in Node.js at the working folder. */
export function absoluteUrl(url: string | URL): string {
  try {
    return new URL(url, base()).href;
  } catch {
    throw new GravisightError("model-url", `"${String(url)}" is not a URL.`);
  }
}

/**
 * A file of this package in full, from `new URL("…", import.meta.url)`: some bundlers (Turbopack) make an object of that whose `href`
 * is a path from the server's root.
 */
export function assetUrl(url: URL): URL {
  return new URL(url.href, base());
}

function base(): string | undefined {
  const { document, location } = globalThis as { document?: Document; location?: Location };
  // Nothing is relative to a blob; its origin is the page's.
  const script = location?.protocol === "blob:" ? location.origin : location?.href;
  return document?.baseURI ?? script ?? workingFolder();
}
