/** The core's names and messages as text for people. */

/** A court's name for people. */
export function spoken(name: string): string {
  const text = name.replaceAll("-", " ").replace(/\b(fiba|nba)\b/, (short) => `(${short.toUpperCase()})`);
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** A message of the core as sentences, without the name of the part that it comes from. */
export function sentences(message: string): string {
  const parts = message.replace(/^calibration: /, "").replaceAll(/`([^`]*)`/g, "“$1”").split("; ");
  return parts.map((part) => `${part.charAt(0).toUpperCase()}${part.slice(1)}${/[.!?]$/.test(part) ? "" : "."}`).join(" ");
}
