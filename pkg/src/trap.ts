/**
 * Traps of the wasm core. One in a future of the core reaches nobody who awaits it: the promise never settles, and
 * the trap surfaces as an uncaught error of the thread. This joins the two.
 */
interface Scope {
  addEventListener(type: "error", listener: (event: ErrorEvent) => void): void;
  addEventListener(type: "unhandledrejection", listener: (event: PromiseRejectionEvent) => void): void;
}

let stop: ((thrown: unknown) => void) | undefined;

/** Lets those uncaught errors that are `ours` end the work that is under way. */
export function watchForTraps(scope: Scope, ours: (thrown: unknown) => boolean): void {
  scope.addEventListener("error", (event) => {
    if (!stop || !ours(event.error)) return;
    event.preventDefault();
    stop(event.error ?? new Error(event.message));
  });
  scope.addEventListener("unhandledrejection", (event) => {
    if (!stop || !ours(event.reason)) return;
    event.preventDefault();
    stop(event.reason);
  });
}

/** Awaits `work`, or rejects with the trap that ended it. One at a time, or one inside another. */
export function untilTrap<T>(work: () => T | Promise<T>): Promise<T> {
  const outer = stop;
  return new Promise<T>((resolve, reject) => {
    stop = reject;
    Promise.resolve().then(work).then(resolve, reject);
  }).finally(() => {
    stop = outer;
  });
}
