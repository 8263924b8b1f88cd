import { createHash } from "node:crypto";
import { cp, mkdir, readdir, readFile, writeFile } from "node:fs/promises";
import { createReadStream, existsSync, statSync } from "node:fs";
import { basename, extname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { defineConfig, type Plugin } from "vite";

const here = fileURLToPath(new URL(".", import.meta.url));
const modelsFolder = fileURLToPath(new URL("../models", import.meta.url));
const modelTypes: Record<string, string> = {
  ".json": "application/json",
  ".safetensors": "application/octet-stream",
};

/** The page's `models/` is the repository's: served as it is in development, copied into a build. */
function models(): Plugin {
  let outDir = "";
  return {
    name: "gravisight-models",
    configResolved(config) {
      outDir = join(config.root, config.build.outDir);
    },
    configureServer(server) {
      server.middlewares.use("/models", (request, response, next) => {
        const name = basename(decodeURIComponent((request.url ?? "").split("?")[0] ?? ""));
        const type = modelTypes[extname(name)];
        const path = join(modelsFolder, name);
        if (!type || !existsSync(path)) return next();
        response.setHeader("Content-Type", type);
        response.setHeader("Content-Length", statSync(path).size);
        createReadStream(path).pipe(response);
      });
    },
    configurePreviewServer(server) {
      // Weights do not compress, and a compressed answer hides their length from the progress bar.
      server.middlewares.use("/models", (request, _response, next) => {
        delete request.headers["accept-encoding"];
        next();
      });
    },
    async closeBundle() {
      if (!existsSync(modelsFolder)) return;
      await mkdir(join(outDir, "models"), { recursive: true });
      for (const name of await readdir(modelsFolder)) {
        if (extname(name) in modelTypes) await cp(join(modelsFolder, name), join(outDir, "models", name));
      }
    },
  };
}

/** Writes the names of the files with a hash into the service worker. */
function offline(): Plugin {
  let outDir = "";
  return {
    name: "gravisight-offline",
    apply: "build",
    configResolved(config) {
      outDir = join(config.root, config.build.outDir);
    },
    async closeBundle() {
      const all = await readdir(join(outDir, "assets"));
      const files = all.filter((name) => [".js", ".css"].includes(extname(name))).map((name) => `./assets/${name}`).sort();
      const build = createHash("sha256").update(files.join()).digest("hex").slice(0, 12);
      const worker = await readFile(join(here, "offline.js"), "utf8");
      const filled = worker.replace("const FILES = [];", `const FILES = ${JSON.stringify(files)};`).replace('const BUILD = "";', `const BUILD = "${build}";`);
      await writeFile(join(outDir, "offline.js"), filled);
    },
  };
}

/** Makes the page cross-origin isolated, so that tracking runs on all threads; served without them it runs on one. */
const headers = { "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Embedder-Policy": "require-corp" };

export default defineConfig({
  root: here,
  // Relative, so that the build can lie in any folder of a server.
  base: "./",
  plugins: [models(), offline()],
  server: { headers },
  preview: { headers },
  build: {
    target: "es2022",
    // What the bundled libraries ask for.
    license: { fileName: "licences.md" },
    rollupOptions: { input: { index: join(here, "index.html"), harness: join(here, "harness.html") } },
  },
});
