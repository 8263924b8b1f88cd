/** What the steps share of the package: one toolbox, made when it is first needed. */
import { Toolbox } from "gravisight";

let toolbox: Promise<Toolbox> | undefined;

/** The page's toolbox; a failed load is tried again by the next call. */
export function tools(): Promise<Toolbox> {
  toolbox ??= Toolbox.create().catch((thrown: unknown) => {
    toolbox = undefined;
    throw thrown;
  });
  return toolbox;
}

/** The page's model. */
export const MODEL = new URLSearchParams(location.search).get("model") ?? `${import.meta.env.BASE_URL}models/sd-l.json`;
