/**
 * Weights that were fetched once, by their sha256, and what was measured once, in the browser's Cache API. Where there is
 * none, nothing is kept.
 */
import { fetchText } from "./fetch.js";
import { ownModel } from "./own.js";
import { absoluteUrl } from "./url.js";
import { VERSION } from "./version.js";

const NAME = "gravisight";
/** Cards that are kept, those that were loaded last; weights are kept as long as a card that is kept names them. */
const MOST_CARDS = 8;
const CARD = "card ";
const TIMES = "times ";

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
    // What is no card must not take the place of one.
    if (useCache && contentOf(text)) {
      await keep(`${CARD}${url}`, text);
      await evict();
    }
    return text;
  } catch (thrown) {
    const kept = useCache ? await cached(`${CARD}${url}`) : null;
    if (kept) return new TextDecoder().decode(kept);
    throw thrown;
  }
}

/** Whether the weights of the model whose card is at `model` (default: the package's own) are kept in this browser. */
export async function isCached(model: string | URL = ownModel().card): Promise<boolean> {
  const sha256 = await sha256Kept(`${CARD}${absoluteUrl(model)}`);
  return sha256 !== undefined && (await cached(sha256)) !== null;
}

/** The sha256 of the weights that a kept card names. */
async function sha256Kept(card: string): Promise<string | undefined> {
  const kept = await cached(card);
  const sha256 = kept && contentOf(new TextDecoder().decode(kept))?.sha256;
  return typeof sha256 === "string" ? sha256 : undefined;
}

/** What a card's text says; undefined of what is no JSON object. */
function contentOf(text: string): { sha256?: unknown } | undefined {
  try {
    const content = JSON.parse(text) as unknown;
    return typeof content === "object" && content ? content : undefined;
  } catch {
    return undefined;
  }
}

/** Drops the cards that were loaded longest ago, weights that no card names any more, and what other versions measured. */
async function evict(): Promise<void> {
  try {
    const cache = await open();
    // In the order in which they were put last.
    const keys = (await cache?.keys()) ?? [];
    const nameOf = ({ url }: Request) => decodeURIComponent(new URL(url).pathname.slice(1));
    const cards = keys.map(nameOf).filter((name) => name.startsWith(CARD)).slice(-MOST_CARDS);
    const kept = new Set([...cards, ...(await Promise.all(cards.map(sha256Kept)))]);
    const isOfVersion = (name: string) => name.startsWith(`${TIMES}[${JSON.stringify(VERSION)}`);
    const dropped = keys.filter((key) => !kept.has(nameOf(key)) && !isOfVersion(nameOf(key)));
    await Promise.all(dropped.map((key) => cache?.delete(key)));
  } catch {
    // what is too much stays for now
  }
}

/** Forgets every model that was kept, and which device was faster. */
export async function clearCache(): Promise<void> {
  await globalThis.caches?.delete(NAME);
}
