/** The units that numbers are shown in. Files are in SI units whatever is shown. */
import type { Measured } from "gravisight";

interface Unit {
  name: string;
  /** How many of it are one metre, one metre a second, or one revolution a second. */
  per: number;
}

export interface Units {
  length: Unit;
  speed: Unit;
  spin: Unit;
}

const METRE = { name: "m", per: 1 };
const RPM = { name: "rpm", per: 60 };

/** By the names of the choice. The foot is 0.3048 m, the mile 1609.344 m by definition. */
const ALL: Record<string, Units> = {
  si: { length: METRE, speed: { name: "m/s", per: 1 }, spin: { name: "rev/s", per: 1 } },
  kmh: { length: METRE, speed: { name: "km/h", per: 3.6 }, spin: RPM },
  mph: { length: { name: "ft", per: 1 / 0.3048 }, speed: { name: "mph", per: 3600 / 1609.344 }, spin: RPM },
};
const KEY = "gravisight.units";

export function unitsOf(name: string): Units {
  return ALL[name] ?? ALL.si!;
}

/** The one that was chosen last. */
export function keptUnits(): string {
  const kept = localStorage.getItem(KEY) ?? "si";
  return kept in ALL ? kept : "si";
}

export function keepUnits(name: string): void {
  localStorage.setItem(KEY, name);
}

/** A number with its uncertainty in a unit: the core's own text in SI units. */
export function inUnit(measured: Measured, unit: Unit): Measured {
  if (unit.per === 1) return measured;
  const sigma = unit.per * measured.amountSigma;
  const format = (value: number) => (unit.per * value).toFixed(digitsOf(sigma)).replace("-", "−");
  const [first = 0, ...rest] = measured.amount;
  const value = rest.length ? ["x", "y", "z"].map((axis, index) => `${axis} ${format(measured.amount[index] ?? 0)}`).join(", ") : format(first);
  return { ...measured, value: `${value} ${unit.name}`, sigma: `${sigma.toFixed(digitsOf(sigma))} ${unit.name}` };
}

/** So many decimals as an uncertainty leaves any sense to. */
function digitsOf(sigma: number): number {
  return sigma < 0.095 ? 2 : sigma < 9.5 ? 1 : 0;
}
