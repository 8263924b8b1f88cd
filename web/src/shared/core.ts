/** What the steps share of the package: one toolbox, made when it is first needed. */
import { Toolbox } from "gravisight";

let toolbox: Promise<Toolbox> | undefined;

/** The page's toolbox; a failed load is tried again by the next call. */
export function tools(): Promise<Toolbox> {
  toolbox ??= Toolbox.create({ threads: "auto" }).catch((thrown: unknown) => {
    toolbox = undefined;
    throw thrown;
  });
  return toolbox;
}

/** The page's models: one for any ball, one for the samples' scenes. */
export const MODELS = { any: `${import.meta.env.BASE_URL}models/any.json`, "sd-l": `${import.meta.env.BASE_URL}models/sd-l.json` } as const;
export type ModelName = keyof typeof MODELS;

/** The one that the address names instead of these. */
export const OWN_MODEL = new URLSearchParams(location.search).get("model");

/** The radius of the ball in the samples and in the scenes to throw one in, m. */
export const SAMPLE_BALL = { radius: 0.2 };

/** The model that is chosen in the step Try, as `loadable` takes it. */
export function chosenModel(): string {
  const chosen = document.querySelector<HTMLInputElement>('#model input[name="model"]:checked')?.value;
  return OWN_MODEL ?? chosen ?? "any";
}
