/** Reads the address: `?device=cpu|webgpu|auto` and `?model=URL of a JSON card`. */
import type { DeviceChoice } from "gravisight";
import { App, type Settings } from "./app";
import { showModelNote } from "./model-note";

const DEVICES: readonly string[] = ["cpu", "webgpu", "auto"] satisfies DeviceChoice[];
const MODEL = `${import.meta.env.BASE_URL}models/sd-l.json`;

function settingsFrom(query: URLSearchParams): Settings {
  const device = query.get("device") ?? "cpu";
  return { model: query.get("model") ?? MODEL, device: DEVICES.includes(device) ? (device as DeviceChoice) : "cpu" };
}

const settings = settingsFrom(new URLSearchParams(location.search));
void new App(settings).start(settings);
void showModelNote(settings.model);
