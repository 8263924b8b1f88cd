/** The Worker: holds the core, answers one request after the other. */
import { lastPanic } from "./builds.js";
import { GravisightError, gravisightErrorFrom, wordsOf } from "./error.js";
import { load } from "./load.js";
import type { Answers, FromWorker, PictureMessage, Requests, ToWorker } from "./protocol.js";
import type { RawLocaliser } from "./raw.js";
import { untilTrap, watchForTraps } from "./trap.js";

/** What is used of `DedicatedWorkerGlobalScope`, whose types exclude those of a page. */
type Scope = Parameters<typeof watchForTraps>[0] & {
  onmessage: (event: MessageEvent<ToWorker>) => void;
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
};
const scope = self as unknown as Scope;

let core: RawLocaliser | undefined;
/** The core's memory cannot be trusted after a trap. */
let trapped: GravisightError | undefined;

watchForTraps(scope);
scope.onmessage = async ({ data }) => {
  const { id } = data;
  try {
    if (data.type === "create") {
      scope.postMessage({ type: "done", id, answer: await create(data, id) });
    } else {
      const answer = await localise(data);
      const maps = answer.maps ? [answer.maps.heatmap.buffer, answer.maps.depth.buffer] : [];
      scope.postMessage({ type: "done", id, answer }, maps);
    }
  } catch (thrown) {
    const error = gravisightErrorFrom(thrown, lastPanic());
    if (error.code === "internal") trapped = error;
    scope.postMessage({ type: "failed", id, code: error.code, message: error.message });
  }
};

async function create(request: Requests["create"], id: number): Promise<Answers["create"]> {
  const loaded = await load(request.model, request.device, (progress) =>
    scope.postMessage({ type: "progress", id, progress }),
  );
  core = loaded.core;
  return loaded.device;
}

async function localise({ picture, camera, options }: Requests["localise"]): Promise<Answers["localise"]> {
  if (trapped) throw trapped;
  const ready = core;
  if (!ready) throw new GravisightError("internal", "The model is not loaded.");
  const input = picture.kind === "bitmap" ? pixelsOf(picture) : picture;
  const start = performance.now();
  const answer = await untilTrap(() =>
    input.kind === "encoded"
      ? ready.localise(input.bytes, camera, options)
      : ready.localiseRgba(input.rgba, input.width, input.height, camera, options),
  );
  return { ...answer, milliseconds: performance.now() - start };
}

function pixelsOf({ bitmap }: PictureMessage & { kind: "bitmap" }): PictureMessage & { kind: "rgba" } {
  const { width, height } = bitmap;
  try {
    const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    if (!context) throw new Error("this browser gives no 2D canvas in a Worker");
    context.drawImage(bitmap, 0, 0);
    const rgba = new Uint8Array(context.getImageData(0, 0, width, height).data.buffer);
    return { kind: "rgba", rgba, width, height };
  } catch (thrown) {
    throw new GravisightError("image-read", `The picture could not be drawn to pixels: ${wordsOf(thrown)}.`, { cause: thrown });
  } finally {
    bitmap.close();
  }
}
