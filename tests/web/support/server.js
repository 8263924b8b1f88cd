/** Serves the built page, as `npm run preview -w web` does. */
import { existsSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { preview } from "vite";

const web = fileURLToPath(new URL("../../../web", import.meta.url));

/** Starts on a free port; `url` ends with a slash. */
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
