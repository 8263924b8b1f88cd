/** Fetching with progress in bytes and clear errors. */
import { GravisightError, messageOf } from "./error.js";
import { isFile, readFile } from "./node.js";

export type OnBytes = (loaded: number, total: number | null) => void;

/** No card, and no weights or build of the core, is larger: whoever sends more than that sends something else. */
const MOST_TEXT = 1 << 20;
const MOST_BYTES = 256 << 20;

/** Fetches the text of `url`. */
export async function fetchText(url: string, what: string): Promise<string> {
  return new TextDecoder().decode(await fetchBytes(url, what, () => {}, MOST_TEXT));
}

/** Whether what `from` names may be fetched from `url`: what came over a network names no file of this machine. */
export function mayFetch(url: string, from: string): boolean {
  const isOfNetwork = (address: string) => /^https?:/.test(address);
  return !isOfNetwork(from) || isOfNetwork(url);
}

async function fileBytes(url: string, what: string): Promise<Uint8Array<ArrayBuffer>> {
  try {
    return await readFile(new URL(url));
  } catch (thrown) {
    throw new GravisightError("fetch", `Could not read ${what} from ${url}: ${messageOf(thrown)}.`, { cause: thrown });
  }
}

/** Fetches `url`; a failure names it and the status. */
async function fetchOk(url: string, what: string): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(url);
  } catch (thrown) {
    throw new GravisightError("fetch", `Could not fetch ${what} from ${url}: ${messageOf(thrown)}.`, { cause: thrown });
  }
  if (!response.ok) {
    throw new GravisightError("fetch", `Could not fetch ${what} from ${url}: the server answered ${statusOf(response)}.`);
  }
  if (isWebPage(response)) {
    throw new GravisightError("fetch", `Could not fetch ${what} from ${url}: the server answered ${statusOf(response)} with a web page. Is the file there?`);
  }
  return response;
}

/** Whether a server answered with its start page, as many do for a file that is not there. */
export function isWebPage(response: Response): boolean {
  return response.headers.get("content-type")?.startsWith("text/html") ?? false;
}

function statusOf(response: Response): string {
  return `${response.status} ${response.statusText}`.trim();
}

/** Fetches the whole of `url`, of at most so many bytes; one that sends more is not heard to its end. */
export async function fetchBytes(url: string, what: string, onBytes: OnBytes, most = MOST_BYTES): Promise<Uint8Array<ArrayBuffer>> {
  if (isFile(url)) {
    const bytes = await fileBytes(url, what);
    onBytes(bytes.length, bytes.length);
    return bytes;
  }
  const response = await fetchOk(url, what);
  const total = lengthOf(response);
  const tooLarge = new GravisightError("fetch", `Could not fetch ${what} from ${url}: it has more than ${most >> 20} MB, so it is a different file.`);
  if (total !== null && total > most) {
    await response.body?.cancel();
    throw tooLarge;
  }
  onBytes(0, total);
  const counted = response.body?.pipeThrough(counter(onBytes, total, most, tooLarge)) ?? null;
  try {
    return new Uint8Array(await new Response(counted).arrayBuffer());
  } catch (thrown) {
    if (thrown instanceof GravisightError) throw thrown;
    throw new GravisightError("fetch", `The connection broke while fetching ${what} from ${url}: ${messageOf(thrown)}.`, { cause: thrown });
  }
}

/** The length that is announced is that of the compressed bytes, while those that arrive are unpacked. */
function lengthOf(response: Response): number | null {
  const announced = Number(response.headers.get("content-length"));
  return announced > 0 && !response.headers.has("content-encoding") ? announced : null;
}

function counter(onBytes: OnBytes, total: number | null, most: number, tooLarge: Error): TransformStream<Uint8Array<ArrayBuffer>, Uint8Array<ArrayBuffer>> {
  let loaded = 0;
  return new TransformStream({
    transform(chunk, controller) {
      loaded += chunk.byteLength;
      if (loaded > most) return controller.error(tooLarge);
      onBytes(loaded, total);
      controller.enqueue(chunk);
    },
  });
}
