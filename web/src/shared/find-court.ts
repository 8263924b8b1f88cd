/** A court's camera without clicks, as the steps Calibrate and Your video look for it. */
import { Toolbox, type CalibrationUnknown, type CourtSearch, type FoundCourt } from "gravisight";
import { tools } from "./core";

/** What the core calls any court. */
const ANY = "auto";
/** The end of the names of tennis courts without the side lines for doubles. */
const SINGLES = /-singles$/;
/** A court with fewer lines cannot be found. */
const FEWEST_LINES = 5;
/** Nothing is certain: there may be another court of another size. */
const MOST_PERCENT = 99;

/** The court of a sport or of a place, if its painted lines are known, so that it can be found. */
export async function findableCourt(sport: string): Promise<string | undefined> {
  if (!sport) return undefined;
  const toolbox = await tools();
  const court = (await toolbox.courts()).find((name) => name.startsWith(sport));
  return court && ((await toolbox.court(court)).lines?.length ?? 0) >= FEWEST_LINES ? court : undefined;
}

/**
 * Looks for a court; of no name, for any. In a Worker of its own: a search may take seconds, and meanwhile the page's toolbox answers.
 * An abort ends that Worker.
 */
export async function findCourt(picture: Blob, court: string, signal: AbortSignal, estimate: CalibrationUnknown[] = []): Promise<CourtSearch> {
  const toolbox = await Toolbox.create({ threads: "auto", signal });
  try {
    return await toolbox.findCourt(picture, court || ANY, { estimate, signal });
  } finally {
    toolbox.dispose();
  }
}

/** The court whose points a found one has. */
export function courtWithPoints(name: string): string {
  return name.replace(SINGLES, "");
}

/** A court's name within a sentence. */
export function courtInWords(name: string): string {
  if (name === "table-tennis") return "table tennis table";
  const court = `${courtWithPoints(name).replaceAll("-", " ").replace(/\b(fiba|nba)\b/, (short) => `(${short.toUpperCase()})`)} court`;
  return SINGLES.test(name) ? `${court} without side lines for doubles` : court;
}

export function percentOf(probability: number): string {
  return `${Math.min(MOST_PERCENT, Math.floor(100 * probability))} %`;
}

/** Such as `tennis court, 97 % probable, 9 of 9 lines`. */
export function foundInWords({ court, probability, lines }: FoundCourt): string {
  const expected = lines.filter(({ isExpected }) => isExpected);
  return `${courtInWords(court)}, ${percentOf(probability)} probable, ${expected.filter(({ isSeen }) => isSeen).length} of ${expected.length} lines`;
}
