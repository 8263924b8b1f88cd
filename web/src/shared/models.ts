/** Models that were tuned here: kept in this browser by name, to be used in place of the published ones. */
import type { Card, Model } from "gravisight";
import { del, get, keys, set } from "idb-keyval";
import { MODELS, type ModelName } from "./core";

const KEPT = "model ";

/** Fires `change` when one is kept or forgotten. */
class KeptModels extends EventTarget {
  /** Their names, in order. */
  async names(): Promise<string[]> {
    const all = await keys<string>();
    return all.filter((key) => key.startsWith(KEPT)).map((key) => key.slice(KEPT.length)).sort();
  }

  /** Keeps a model, in place of the one with its name. Throws where the browser has no room. */
  async keep(name: string, model: Model): Promise<void> {
    await set(KEPT + name, model);
    this.dispatchEvent(new Event("change"));
  }

  async get(name: string): Promise<Model | undefined> {
    return get<Model>(KEPT + name);
  }

  async forget(name: string): Promise<void> {
    await del(KEPT + name);
    this.dispatchEvent(new Event("change"));
  }
}

export const keptModels = new KeptModels();

/** What a choice of a model is written as: the name of a published one, or this before the name of a kept one. */
export const MINE = "kept ";

/** The choice as the package takes it. Throws in words where it was forgotten meanwhile. */
export async function loadable(choice: string): Promise<string | Model> {
  if (!choice.startsWith(MINE)) return choice in MODELS ? MODELS[choice as ModelName] : choice;
  const name = choice.slice(MINE.length);
  const model = await keptModels.get(name);
  if (!model) throw new Error(`The model “${name}” is no longer in this browser. Choose another one.`);
  return model;
}

/** Whether a kept model takes balls of any size, as videos need it. */
export async function readsSizes(name: string): Promise<boolean> {
  const model = await keptModels.get(name);
  return model !== undefined && (JSON.parse(model.card) as Card).depth_from === "size";
}
