/**
 * Traps of the wasm core. One in a future of the core reaches nobody who awaits it: the promise never settles, and
 * the trap surfaces as an uncaught error of the thread. This joins the two.
 */
interface Scope {
  addEventListener(type: "error", listener: (event: ErrorEvent) => void): void;
  addEventListener(type: "unhandledrejection", listener: (event: PromiseRejectionEvent) => void): void;
}

/** What ends the work that is under way, by whose it is: several objects may be at work on one thread. */
const stops = new Map<object, (thrown: unknown) => void>();
let watching = false;

/** Whether WebAssembly threw this; anything else is an error of JavaScript's, perhaps the user's. */
export function isTrap(thrown: unknown): boolean {
  if (thrown instanceof WebAssembly.RuntimeError) return true;
  // A full stack is JavaScript's own error in wasm, too: RangeError in V8 and JavaScriptCore, InternalError in Firefox.
  return thrown instanceof Error && /^(Range|Internal)Error$/.test(thrown.name) && /wasm/.test(thrown.stack ?? "");
}

/**
 * Lets uncaught traps of WebAssembly end all work that is under way, with the error that `errorOf` makes of them; other errors are
 * the user's, who hears of them as ever. Who watches first, stays.
 */
export function watchForTraps(scope: Scope, errorOf: (thrown: unknown) => Error): void {
  if (watching) return;
  watching = true;
  const end = (event: Event, thrown: unknown) => {
    if (stops.size === 0 || !isTrap(thrown)) return;
    event.preventDefault();
    // Nobody knows whose it was, and all may be in the memory that it has left behind. One error for all: a panic reports its message once.
    const error = errorOf(thrown);
    for (const stop of [...stops.values()]) stop(error);
  };
  scope.addEventListener("error", (event) => end(event, event.error));
  scope.addEventListener("unhandledrejection", (event) => end(event, event.reason));
}

/** Awaits `work` of an object, or rejects with the trap that ended it. One at a time each, or one inside another. */
export function untilTrap<T>(of: object, work: () => T | Promise<T>): Promise<T> {
  const outer = stops.get(of);
  return new Promise<T>((resolve, reject) => {
    stops.set(of, reject);
    Promise.resolve().then(work).then(resolve, reject);
  }).finally(() => {
    if (outer) stops.set(of, outer);
    else stops.delete(of);
  });
}
