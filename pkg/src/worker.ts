/** The Worker: an engine for each object of the pages' end. Import it in a Worker of your own to use that one. */
import { errorOfCore } from "./builds.js";
import { GravisightError } from "./error.js";
import { Inline } from "./inline.js";
import { ownPort } from "./node.js";
import type { FromWorker, ToWorker } from "./protocol.js";
import { threadsChannel } from "./threads.js";
import { transferablesOf } from "./transfer.js";
import { watchForTraps } from "./trap.js";

/** What is used of `DedicatedWorkerGlobalScope`, whose types exclude those of a page. */
type Scope = Parameters<typeof watchForTraps>[0] & {
  addEventListener(type: "message", listener: (event: MessageEvent<ToWorker>) => void): void;
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
};
const scope = ownPort<Scope>() ?? (self as unknown as Scope);
/** By the name that the page's end gave it. */
const objects = new Map<string, Inline>();

watchForTraps(scope, errorOfCore);
scope.addEventListener("message", async ({ data }) => {
  // Messages of the user's own Worker are none of ours.
  if (typeof data?.object !== "string") return;
  const { object } = data;
  if (data.type === "close") {
    // Its page's end has rejected all calls that wait.
    objects.get(object)?.close(new GravisightError("disposed", "This was disposed of."));
    objects.delete(object);
    return;
  }
  if (data.type === "hello" || !objects.has(object)) scope.postMessage({ type: "here", object, threads: threadsChannel() });
  if (data.type === "hello") return;
  const engine = objects.get(object) ?? new Inline();
  if (typeof data.id !== "number" || !engine.knows(data.type)) return;
  objects.set(object, engine);
  const { id } = data;
  try {
    const answer = await engine.call(data.type, data.request, { onProgress: (progress) => scope.postMessage({ type: "progress", object, id, progress }) });
    scope.postMessage({ type: "done", object, id, answer }, transferablesOf(answer));
  } catch (thrown) {
    const { code, message } = errorOfCore(thrown);
    scope.postMessage({ type: "failed", object, id, code, message });
  }
});
