/** Keeps the page in the browser, so that it opens without a network the next time. */
import { coreFiles } from "gravisight";
import { MODELS, OWN_MODEL } from "./shared/core";

/** The example that comes with the page and is fetched only when it is opened. */
const RALLY = ["rally/rally.json", "rally/tennis.mp4"];

/** Resolves once all that the page needs is kept; never where the browser, or a development server, keeps nothing. */
export async function keepForOffline(): Promise<void> {
  const container = (navigator as { serviceWorker?: ServiceWorkerContainer }).serviceWorker;
  if (!import.meta.env.PROD || !container) return new Promise(() => {});
  await container.register(`${import.meta.env.BASE_URL}offline.js`);
  if (!container.controller) await new Promise((resolve) => container.addEventListener("controllerchange", resolve, { once: true }));
  // What was fetched before the service worker was there.
  const seen = performance.getEntriesByType("resource").map(({ name }) => name);
  // Their weights keep themselves, by sha256, once they are loaded.
  const models = OWN_MODEL === null ? Object.values(MODELS) : [];
  // Single pictures are found on one thread, videos on all that there may be.
  const core = [...(await coreFiles()), ...(await coreFiles("cpu", { threads: "auto" }))];
  const files = new Set([location.href, ...seen, ...[...models, ...RALLY.map((file) => import.meta.env.BASE_URL + file)].map((file) => new URL(file, location.href).href), ...core]);
  for (const file of files) {
    const isOurs = new URL(file).origin === location.origin;
    if (isOurs && !(await caches.match(file, { ignoreSearch: true }))) await (await fetch(file)).arrayBuffer();
  }
}
