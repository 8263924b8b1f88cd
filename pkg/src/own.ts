import { assetUrl } from "./url.js";

/** The package's own model, which takes any ball. Bundlers look for the literal form of each URL, and may name the files as they like. */
export function ownModel(): { card: string; weights: string } {
  return {
    card: assetUrl(new URL("../models/any.json", import.meta.url)).href,
    weights: assetUrl(new URL("../models/any.safetensors", import.meta.url)).href,
  };
}
