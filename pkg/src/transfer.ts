/** The buffers in an answer, which move to the page rather than being copied. */
export function transferablesOf(answer: unknown): Transferable[] {
  if (ArrayBuffer.isView(answer)) return [answer.buffer as ArrayBuffer];
  if (answer === null || typeof answer !== "object") return [];
  return Object.values(answer).flatMap((value) => (value !== null && typeof value === "object" ? transferablesOf(value) : []));
}
