/** Fetching with progress in bytes and failures in words. */
import { GravisightError, wordsOf } from "./error.js";
import { isFile, readFile } from "./node.js";

export type OnBytes = (loaded: number, total: number | null) => void;

/** Fetches the text of `url`. */
export async function fetchText(url: string, what: string): Promise<string> {
  if (isFile(url)) return new TextDecoder().decode(await fileBytes(url, what));
  return (await fetchOk(url, what)).text();
}

async function fileBytes(url: string, what: string): Promise<Uint8Array<ArrayBuffer>> {
  try {
    return await readFile(new URL(url));
  } catch (thrown) {
    throw new GravisightError("fetch", `Could not read ${what} from ${url}: ${wordsOf(thrown)}.`, { cause: thrown });
  }
}

/** Fetches `url`; a failure names it and the status. */
async function fetchOk(url: string, what: string): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(url);
  } catch (thrown) {
    throw new GravisightError("fetch", `Could not fetch ${what} from ${url}: ${wordsOf(thrown)}.`, { cause: thrown });
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

/** Fetches the whole of `url`. */
export async function fetchBytes(url: string, what: string, onBytes: OnBytes): Promise<Uint8Array<ArrayBuffer>> {
  if (isFile(url)) {
    const bytes = await fileBytes(url, what);
    onBytes(bytes.length, bytes.length);
    return bytes;
  }
  const response = await fetchOk(url, what);
  const total = lengthOf(response);
  onBytes(0, total);
  const counted = response.body?.pipeThrough(counter(onBytes, total)) ?? null;
  try {
    return new Uint8Array(await new Response(counted).arrayBuffer());
  } catch (thrown) {
    throw new GravisightError("fetch", `The connection broke while fetching ${what} from ${url}: ${wordsOf(thrown)}.`, { cause: thrown });
  }
}

/** The length that is announced is that of the compressed bytes, while those that arrive are unpacked. */
function lengthOf(response: Response): number | null {
  const announced = Number(response.headers.get("content-length"));
  return announced > 0 && !response.headers.has("content-encoding") ? announced : null;
}

function counter(onBytes: OnBytes, total: number | null): TransformStream<Uint8Array<ArrayBuffer>, Uint8Array<ArrayBuffer>> {
  let loaded = 0;
  return new TransformStream({
    transform(chunk, controller) {
      loaded += chunk.byteLength;
      onBytes(loaded, total);
      controller.enqueue(chunk);
    },
  });
}
