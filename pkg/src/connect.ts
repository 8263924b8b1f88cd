import { Channel } from "./channel.js";
import { GravisightError, messageOf } from "./error.js";
import { Inline } from "./inline.js";
import { runsHere } from "./threads.js";
import type { Transport } from "./protocol.js";
import type { CoreOptions } from "./types.js";

/** Where the engine runs: a Worker of its own, the user's, or this thread (where there are no Workers, too). */
export function connect(options: CoreOptions): Transport {
  if (runsHere(options)) return new Inline();
  return new Channel(typeof options.worker === "object" ? options.worker : undefined);
}

/** What later calls of a disposed object reject with. */
export function disposed(name: string): GravisightError {
  return new GravisightError("disposed", `This ${name} was disposed of. Create a new one.`);
}

/** `using` frees what has this; browsers without it do not know the symbol. */
export function makeDisposable(of: { prototype: { dispose(): void } }): void {
  const symbol = (Symbol as { dispose?: symbol }).dispose;
  if (!symbol) return;
  Object.defineProperty(of.prototype, symbol, {
    value(this: { dispose(): void }) {
      this.dispose();
    },
  });
}

/** All fields of `T`, so that the compiler refuses a message that lacks one. */
export type Whole<T> = { [K in keyof Required<T>]: T[K] | undefined };

/** A message of which every field is named, without those that are undefined: no option is lost on its way. */
export function whole<T extends object>(fields: Whole<T>): T {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => value !== undefined)) as T;
}

/** What may be called not finite, or of the wrong form. */
export type JsonName = "camera" | "cameraSigma" | "clip" | "config" | "options" | "points" | "scene" | "track";

/** JSON would silently turn NaN and infinity into null. */
export function jsonOf(thing: unknown, name: JsonName): string {
  const finite = (key: string, value: unknown) => {
    if (typeof value === "number" && !Number.isFinite(value)) {
      throw new GravisightError(`${name}-not-finite`, `The ${name} holds ${value} at "${key}"; every number must be finite.`);
    }
    return value;
  };
  let json: string | undefined;
  try {
    json = JSON.stringify(thing, finite);
  } catch (thrown) {
    if (thrown instanceof GravisightError) throw thrown;
    throw new GravisightError(`${name}-format`, `The ${name} cannot be written as JSON: ${messageOf(thrown)}.`, { cause: thrown });
  }
  if (json === undefined) throw new GravisightError(`${name}-format`, `The ${name} is ${typeof thing}, not a ${name}.json object.`);
  return json;
}
