/** A thread of the core, in a Worker that has its memory. {@link startThreads} starts it. */
import type { CoreModule } from "./builds.js";
import { ownPort } from "./node.js";

/** The first message to a thread. */
export interface ThreadStart {
  /** The build's script, and its module and memory. */
  glue: string;
  module: WebAssembly.Module;
  memory: WebAssembly.Memory;
  /** The `BroadcastChannel` on which it tells a trap: the thread that would, waits for it. */
  channel: string;
}

/** A build with threads. */
export type ThreadedModule = CoreModule & { startThreads(count: number): void; runThread(): void };

/** What is used of a Worker's own scope, and of Node.js' port. */
interface Port {
  onmessage: ((event: MessageEvent<ThreadStart>) => void) | null;
  postMessage(message: string): void;
}

const port = ownPort<Port>() ?? (self as unknown as Port);
port.onmessage = async ({ data: { glue, module, memory, channel } }) => {
  const core = (await import(/* @vite-ignore */ /* webpackIgnore: true */ glue)) as ThreadedModule;
  await core.default({ module_or_path: module, memory });
  port.postMessage("ready");
  try {
    core.runThread();
  } catch (thrown) {
    new BroadcastChannel(channel).postMessage(core.lastPanic() || String(thrown));
    throw thrown;
  }
};
