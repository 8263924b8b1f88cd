/**
 * Traps of the wasm core. One in a future of the core reaches nobody who awaits it: the promise never settles, and
 * the trap surfaces as an uncaught error of the Worker. This joins the two.
 */
interface Scope {
  addEventListener(type: "error", listener: (event: ErrorEvent) => void): void;
  addEventListener(type: "unhandledrejection", listener: (event: PromiseRejectionEvent) => void): void;
}

let stop: ((thrown: unknown) => void) | undefined;

/** Lets uncaught errors end the work that is under way. */
export function watchForTraps(scope: Scope): void {
  scope.addEventListener("error", (event) => {
    event.preventDefault();
    stop?.(event.error ?? new Error(event.message));
  });
  scope.addEventListener("unhandledrejection", (event) => {
    event.preventDefault();
    stop?.(event.reason);
  });
}

/** Awaits `work`, or rejects with the trap that ended it. One at a time. */
export function untilTrap<T>(work: () => Promise<T>): Promise<T> {
  return new Promise<T>((resolve, reject) => {
    stop = reject;
    work().then(resolve, reject);
  }).finally(() => {
    stop = undefined;
  });
}
