import type { JsonName } from "./connect.js";

/** Codes that come from this package itself; those of the core (such as `camera-singular`) come on top. */
export type FacadeErrorCode =
  | "camera-missing"
  | "card-json"
  | "cpu-build-missing"
  | "device"
  | "disposed"
  | "fetch"
  | "image-read"
  | "internal"
  | "model-format"
  | "model-url"
  | "node-version"
  | "not-loaded"
  | "scene-missing"
  | "threads"
  | "timestamp-order"
  | "webgpu-build-missing"
  | "webgpu-no-adapter"
  | "worker"
  | `${JsonName}-not-finite`
  | `${JsonName}-format`;

/** Everything that this package throws, except the reason of an `AbortSignal`. */
export class GravisightError extends Error {
  /** Distinguishes it from other errors across Workers and bundles. */
  override readonly name = "GravisightError";
  /** What went wrong, for a program; `message` says it in words. */
  readonly code: FacadeErrorCode | (string & {});

  constructor(code: FacadeErrorCode | (string & {}), message: string, options?: ErrorOptions) {
    super(message, options);
    this.code = code;
  }
}

/** The message of anything that was thrown. */
export function messageOf(thrown: unknown): string {
  return thrown instanceof Error ? thrown.message || thrown.name : String(thrown);
}

/**
 * Turns anything that was thrown into a {@link GravisightError}; what has no code of its own is `internal`, and says
 * `panic`, the message of a trap's panic, where there is one.
 */
export function gravisightErrorFrom(thrown: unknown, panic = ""): GravisightError {
  if (thrown instanceof GravisightError) return thrown;
  // The core's errors are made in Rust: an `Error` with this name and a code, not this class.
  if (thrown instanceof Error && thrown.name === "GravisightError" && "code" in thrown) {
    return new GravisightError(String(thrown.code), thrown.message);
  }
  return new GravisightError("internal", `The core stopped unexpectedly: ${panic || messageOf(thrown)}.`, { cause: thrown });
}
