/** What the model's card says of it: where it may be trusted, and how far off it is. */
import { element } from "./dom";

interface Card {
  name?: string;
  description?: string;
  metrics?: { dtg?: { mean?: number; std?: number; n?: number } } | null;
}

/** Writes it under the page. A card that cannot be had is the loading's matter, which says so itself. */
export async function showModelNote(url: string): Promise<void> {
  const response = await fetch(url).catch(() => null);
  if (!response?.ok) return;
  const card = (await response.json().catch(() => null)) as Card | null;
  if (card) element("model-note").textContent = noteOf(card);
}

function noteOf({ name, description, metrics }: Card): string {
  const dtg = metrics?.dtg;
  const centimetres = (metres: number) => (metres * 100).toFixed(1);
  const error =
    dtg?.mean !== undefined && dtg.std !== undefined
      ? `On ${dtg.n} test pictures it is off by ${centimetres(dtg.mean)} ± ${centimetres(dtg.std)} cm.`
      : "";
  return `Model ${name ?? ""}: ${description ?? ""} ${error}`.trim();
}
