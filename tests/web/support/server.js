/** Servers: of the built page, and of any folder. */
import { existsSync, readFileSync, statSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { preview } from "vite";

const web = fileURLToPath(new URL("../../../web", import.meta.url));

/** Serves the built page, as `npm run preview -w web` does, on a free port; `url` ends with a slash. */
export async function serve() {
  if (!existsSync(`${web}/dist/index.html`)) throw new Error("web/dist is not there: run `npm run build` first");
  const server = await preview({
    root: web,
    configFile: `${web}/vite.config.ts`,
    logLevel: "error",
    // The system chooses.
    preview: { port: 0, host: "127.0.0.1", strictPort: false },
  });
  const { port } = server.httpServer.address();
  return { url: `http://127.0.0.1:${port}/`, close: () => server.close() };
}

const TYPES = { ".js": "text/javascript", ".html": "text/html", ".wasm": "application/wasm", ".json": "application/json", ".css": "text/css", ".svg": "image/svg+xml" };

/** Serves a folder, under a content security policy if that is not empty; its pages cross-origin isolated if asked for. */
export async function serveFolder(folder, policy, isolated = false) {
  const server = createServer((request, response) => {
    const path = join(folder, decodeURIComponent(new URL(request.url, "http://localhost").pathname));
    if (path.includes("..") || !existsSync(path) || !statSync(path).isFile()) return response.writeHead(404).end();
    response.setHeader("Content-Type", TYPES[extname(path)] ?? "application/octet-stream");
    if (isolated) {
      response.setHeader("Cross-Origin-Opener-Policy", "same-origin");
      response.setHeader("Cross-Origin-Embedder-Policy", "require-corp");
    }
    if (policy) response.setHeader("Content-Security-Policy", policy);
    response.end(readFileSync(path));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return { url: `http://127.0.0.1:${server.address().port}/`, close: () => server.close() };
}
