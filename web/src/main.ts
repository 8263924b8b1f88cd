/** Reads the address: `?device=cpu|webgpu|auto`, and in the step's files `?model=URL of a JSON card`. */
import "./shared/trusted";
import type { DeviceChoice } from "gravisight";
import { element } from "./dom";
import { startLive } from "./live";
import { keepForOffline } from "./offline";
import { startTabs } from "./tabs";
import { App, type Settings } from "./try";

const DEVICES: readonly string[] = ["cpu", "webgpu", "auto"] satisfies DeviceChoice[];

function settingsFrom(query: URLSearchParams): Settings {
  const device = query.get("device") ?? "cpu";
  return { device: DEVICES.includes(device) ? (device as DeviceChoice) : "cpu" };
}

startTabs();
const settings = settingsFrom(new URLSearchParams(location.search));
const app = new App();
// Below the fold: after what is seen first.
setTimeout(() => startLive(element("live"), () => app.localiser));
await app.start(settings);
try {
  await keepForOffline();
  element("offline-note").textContent = "This page is kept in your browser and also opens without a network.";
} catch {
  // The browser forbids it, or the network broke: the page works as well without.
}
