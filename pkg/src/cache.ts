/**
 * Weights that were fetched once, by their sha256, and what was measured once, in the browser's Cache API. Where there is
 * none, nothing is kept.
 */
import { fetchText } from "./fetch.js";
import { ownModel } from "./own.js";
import { absoluteUrl } from "./url.js";

const NAME = "gravisight";

/** Keys must be URLs; nothing is ever fetched from these. */
function keyOf(what: string): Request {
  return new Request(`https://gravisight.invalid/${encodeURIComponent(what)}`);
}

async function open(): Promise<Cache | null> {
  try {
    return (await globalThis.caches?.open(NAME)) ?? null;
  } catch {
    return null; // not in a secure context, or forbidden by the user
  }
}

export async function cached(what: string): Promise<Uint8Array<ArrayBuffer> | null> {
  const response = await (await open())?.match(keyOf(what));
  return response ? new Uint8Array(await response.arrayBuffer()) : null;
}

/** Keeps `bytes`; a full disk is no reason to fail. */
export async function keep(what: string, bytes: Uint8Array<ArrayBuffer> | string): Promise<void> {
  try {
    await (await open())?.put(keyOf(what), new Response(bytes));
  } catch {
    // the next load fetches again
  }
}

/** The card at `url`: from the network, so that a new model is seen; without one, as it was last. */
export async function cardText(url: string, useCache: boolean): Promise<string> {
  try {
    const text = await fetchText(url, "the model's card");
    if (useCache) await keep(`card ${url}`, text);
    return text;
  } catch (thrown) {
    const kept = useCache ? await cached(`card ${url}`) : null;
    if (kept) return new TextDecoder().decode(kept);
    throw thrown;
  }
}

/** Whether the weights of the model whose card is at `model` (default: the package's own) are kept in this browser. */
export async function isCached(model: string | URL = ownModel().card): Promise<boolean> {
  const kept = await cached(`card ${absoluteUrl(model)}`);
  if (!kept) return false;
  try {
    const { sha256 } = JSON.parse(new TextDecoder().decode(kept)) as { sha256?: unknown };
    return typeof sha256 === "string" && (await cached(sha256)) !== null;
  } catch {
    return false;
  }
}

/** Forgets every model that was kept, and which device was faster. */
export async function clearCache(): Promise<void> {
  await globalThis.caches?.delete(NAME);
}
