/**
 * The service worker. Files with a hash in their name come from the cache, all others from the network first, so that no visitor sees
 * files of two versions. Weights are not its business: the package keeps them, by their sha256.
 */

/** The files with a hash in their name, and a name for all of them together: the build writes both. */
const FILES = [];
const BUILD = "";

const SHELL = `shell ${BUILD}`;
const WASM = "wasm";
const OTHERS = "files";
/** Builds of the core that are kept; each version of the page has its own. */
const MOST_WASM = 4;
/** A file is the same whoever asks for it: some servers say that it varies with the asker's origin. */
const SAME_NAME = { ignoreVary: true };

self.addEventListener("install", (event) => event.waitUntil(keepShell()));
self.addEventListener("activate", (event) => event.waitUntil(begin()));
self.addEventListener("fetch", (event) => {
  const { request } = event;
  const { origin, pathname } = new URL(request.url);
  if (request.method !== "GET" || origin !== location.origin || pathname.endsWith(".safetensors")) return;
  const later = (work) => event.waitUntil(work);
  if (pathname.endsWith(".wasm")) event.respondWith(cacheFirst(request, WASM, later));
  else if (FILES.some((file) => new URL(file, location.href).pathname === pathname)) event.respondWith(cacheFirst(request, SHELL, later));
  else event.respondWith(networkFirst(request, later));
});

async function keepShell() {
  const cache = await caches.open(SHELL);
  await cache.addAll(FILES);
}

/** The pages of the last version are closed: its files go. */
async function begin() {
  const kept = [SHELL, WASM, OTHERS];
  for (const name of await caches.keys()) if (isOurs(name) && !kept.includes(name)) await caches.delete(name);
  await self.clients.claim();
}

/** Those of the library that did this before included. The package's own cache is not. */
function isOurs(name) {
  return name.startsWith("shell ") || name.startsWith("workbox-");
}

async function cacheFirst(request, name, later) {
  const cache = await caches.open(name);
  const kept = await cache.match(request, SAME_NAME);
  if (kept) return kept;
  const response = await fetch(request);
  later(keep(cache, request, response.clone()).then(() => name === WASM && forgetOldest(cache)));
  return response;
}

async function networkFirst(request, later) {
  const cache = await caches.open(OTHERS);
  try {
    const response = await fetch(request);
    later(keep(cache, request, response.clone()));
    return response;
  } catch (thrown) {
    const kept = await cache.match(request, { ...SAME_NAME, ignoreSearch: true });
    if (kept) return kept;
    throw thrown;
  }
}

/** A browser without room goes on without. */
async function keep(cache, request, response) {
  if (!response.ok || response.redirected) return;
  await cache.put(request, response).catch(() => undefined);
}

async function forgetOldest(cache) {
  const all = await cache.keys();
  await Promise.all(all.slice(0, Math.max(0, all.length - MOST_WASM)).map((request) => cache.delete(request)));
}
