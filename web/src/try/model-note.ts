/** What the model's card says of it: where it may be trusted, and how far off it is. */
import type { Card } from "gravisight";
import { element } from "../dom";

/** Writes it under the page. */
export function showModelNote(card: Card): void {
  element("model-note").textContent = noteOf(card);
}

function noteOf({ name, description, metrics }: Card): string {
  const dtg = metrics?.dtg;
  const centimetres = (metres: number) => (metres * 100).toFixed(1);
  const error =
    typeof dtg?.mean === "number" && typeof dtg.std === "number"
      ? `Its error on ${dtg.n} test pictures is ${centimetres(dtg.mean)} ± ${centimetres(dtg.std)} cm.`
      : "";
  return `Model ${name}: ${description} ${error}`.trim();
}
