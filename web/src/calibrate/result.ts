/** The camera that the core made of the clicks, how sure it is, and which clicks it does not believe. */
import type { LineSeen } from "gravisight";
import { make } from "../dom";
import type { Parts } from "../shared/panel";
import type { Calibration } from "./calibration";
import { offBy } from "./list";
import { sentences } from "./words";

export class Result {
  readonly #part: Parts;

  constructor(part: Parts) {
    this.#part = part;
  }

  /** There is none, and why. */
  showNone(why: string): void {
    this.hint(why);
    this.#part("cal-found").hidden = true;
    this.#part("cal-outliers").replaceChildren();
    this.#part("cal-doubts").replaceChildren();
    this.#enable(false);
  }

  /** One is being computed; the last one stays until it is there. */
  await(): void {
    if (this.#part("cal-found").hidden) this.hint("Computing the camera…");
  }

  /** `isAsked`: a person has to confirm it first. */
  show({ found: { camera, rmsPx, sigma, pointSigma, centre, doubts, lines }, outliers, withoutLines }: Calibration, nameOf: (index: number) => string, isAsked: boolean): void {
    this.hint(isAsked ? "Do the lines lie on the court’s? Answer below the picture to use this camera." : "");
    this.#part("cal-found").hidden = false;
    const [[focal = NaN] = []] = camera.intrinsic;
    this.#number("cal-rms", [rmsPx], (value) => value.toFixed(2));
    this.#number("cal-centre", centre, (value) => value.toFixed(2));
    this.#number("cal-centre-sigma", sigma.centre, centimetres);
    this.#number("cal-point-sigma", pointSigma.world, centimetres);
    this.#number("cal-focal-found", [focal], (value) => value.toFixed(1) + (sigma.focalPx > 0 ? ` ± ${sigma.focalPx.toFixed(1)}` : ""));
    this.#part("cal-sigma-note").textContent = `Uncertainties along x, y and z: two times out of three the error is smaller. The ball’s is for the middle of the picture, ${pointSigma.depth.toFixed(1)} m from the camera, and includes only the camera’s errors.`;
    this.#part("cal-outliers").replaceChildren(
      ...[...outliers].map(([index, { residualPx }]) => {
        const item = make("li", { class: "callout" }, make("strong", { text: `Wrong click? ${nameOf(index)}` }));
        item.append(` does not fit the others and was left out. The camera puts it ${offBy(residualPx)} from your click.`);
        return item;
      }),
    );
    this.#part("cal-lines").textContent = withoutLines ? `From the clicks only: the painted lines could not be used. ${sentences(withoutLines)}` : linesText(lines);
    this.#part("cal-doubts").replaceChildren(
      ...doubts.map((doubt) => {
        const item = make("li", { class: "callout" }, make("strong", { text: "Doubtful" }));
        item.append(`: ${doubt}`);
        return item;
      }),
    );
    this.#enable(!isAsked);
  }

  hint(text: string): void {
    this.#part("cal-hint").textContent = text;
  }

  #enable(isFound: boolean): void {
    for (const name of ["cal-use", "cal-save"]) this.#part<HTMLButtonElement>(name).disabled = !isFound;
  }

  #number(name: string, values: number[], format: (value: number) => string): void {
    const place = this.#part<HTMLDataElement>(name);
    place.value = values.join(" ");
    place.textContent = values.map(format).join(" · ");
  }
}

function linesText(lines: LineSeen[]): string {
  const expected = lines.filter(({ isExpected }) => isExpected);
  const found = expected.filter(({ share }) => share > 0);
  if (found.length === 0) return "";
  const rms = Math.hypot(...found.map(({ rmsPx }) => rmsPx)) / Math.sqrt(found.length);
  return `Refined with ${found.length} of the ${expected.length} painted lines that the picture should show; they lie ${rms.toFixed(2)} pixels from where the camera puts them.`;
}

function centimetres(metres: number): string {
  const value = 100 * metres;
  return value < 0.05 ? "< 0.1" : value.toFixed(value < 10 ? 1 : 0);
}
