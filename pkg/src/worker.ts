/** The Worker: an engine that answers one message after the other. Import it in a Worker of your own to use that one. */
import { Engine } from "./engine.js";
import { gravisightErrorFrom } from "./error.js";
import { lastPanic } from "./builds.js";
import type { FromWorker, ToWorker } from "./protocol.js";
import { transferablesOf } from "./transfer.js";
import { watchForTraps } from "./trap.js";

/** What is used of `DedicatedWorkerGlobalScope`, whose types exclude those of a page. */
type Scope = Parameters<typeof watchForTraps>[0] & {
  addEventListener(type: "message", listener: (event: MessageEvent<ToWorker>) => void): void;
  postMessage(message: FromWorker, transfer?: Transferable[]): void;
};
const scope = self as unknown as Scope;
const engine = new Engine();

watchForTraps(scope, () => true);
scope.addEventListener("message", async ({ data }) => {
  // Messages of the user's own Worker are none of ours.
  if (typeof data?.id !== "number" || !engine.knows(data.type)) return;
  const { id } = data;
  try {
    const answer = await engine.call(data.type, data.request, (progress) => scope.postMessage({ type: "progress", id, progress }));
    scope.postMessage({ type: "done", id, answer }, transferablesOf(answer));
  } catch (thrown) {
    const { code, message } = gravisightErrorFrom(thrown, lastPanic());
    scope.postMessage({ type: "failed", id, code, message });
  }
});
