/**
 * PEN in Chromium beside onnxruntime-web: same weights, same picture, one thread (or with the build `webgpu` both on WebGPU), runs taken in
 * turns in one page. `--check` instead of build
 * and peers: a published model alone, once, in the plain CPU build, to see that it runs.
 */
import { createServer } from "node:http";
import { readFile } from "node:fs/promises";
import { join, normalize } from "node:path";
import { fileURLToPath } from "node:url";
import { launch } from "../../tests/web/support/browser.js";

const isCheck = process.argv[2] === "--check";
const [build, peers] = isCheck ? ["cpu", ""] : process.argv.slice(2);
const device = build === "webgpu" ? "webgpu" : "cpu";
const root = fileURLToPath(new URL("../..", import.meta.url));
const folders = {
  "/wasm/": join(root, "pkg/wasm", build),
  "/ort/": join(peers, "node_modules/onnxruntime-web/dist"),
  "/models/": isCheck ? join(root, "models") : join(peers, "models"),
  "/samples/": join(root, "web/public/samples"),
};
const types = { js: "text/javascript", mjs: "text/javascript", wasm: "application/wasm", json: "application/json" };

const server = createServer(async (request, response) => {
  const path = new URL(request.url, "http://localhost").pathname;
  const folder = Object.keys(folders).find((start) => path.startsWith(start));
  if (path === "/") return response.setHeader("Content-Type", "text/html").end("<!doctype html><title>benchmark</title>");
  try {
    const bytes = await readFile(join(folders[folder], normalize(path.slice(folder.length))));
    response.setHeader("Content-Type", types[path.split(".").pop()] ?? "application/octet-stream").end(bytes);
  } catch {
    response.writeHead(404).end();
  }
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
const browser = await launch({ webgpu: device === "webgpu" });
try {
  const page = await browser.newPage();
  page.on("pageerror", (error) => console.error(String(error)));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  console.log(`Chromium ${browser.version()}, ${device === "cpu" ? "one thread" : "WebGPU"}, build ${build}: medians, in turns`);
  const jobs = [
    { name: "compact", limit: 0.5, milliseconds: 20_000, peer: true },
    { name: "resnet34", limit: 0.5, milliseconds: 60_000, peer: true },
  ];
  for (const { limit, ...job } of isCheck ? [{ name: "sd-l", limit: Infinity, milliseconds: 1, peer: false }] : jobs) {
    const { name } = job;
    const { ours, theirs, file, ran, runs, difference } = await page.evaluate(contest, { ...job, device });
    const ratio = ours / theirs;
    console.log(
      `${name.padEnd(9)} ${ours.toFixed(2)} ms (${ran}), onnxruntime-web ${theirs.toFixed(2)} ms; ratio ${ratio.toFixed(2)} ` +
        `(at most ${limit}${ratio > limit ? "  MISSED" : ""}); from a PNG file, decoding and read-back included ` +
        `${file.toFixed(2)} ms = ${(1000 / file).toFixed(0)} pictures/s; ${runs} runs; depth differs by ${difference.toExponential(0)}`,
    );
  }
} finally {
  await browser.close();
  server.close();
}

/** In the page. Ours takes RGBA pixels and gives metres; the peer only runs the network. Without a peer ours stands in for it. */
async function contest({ name, milliseconds, peer, device }) {
  const text = async (path) => (await fetch(path)).text();
  const bytes = async (path) => new Uint8Array(await (await fetch(path)).arrayBuffer());
  const module = await import("/wasm/gravisight.js");
  await module.default({ module_or_path: await bytes("/wasm/gravisight_bg.wasm") });
  const localiser = await module.Localiser.create(await text(`/models/${name}.json`), await bytes(`/models/${name}.safetensors`), device);
  const samples = JSON.parse(await text("/samples/samples.json"));
  const camera = JSON.stringify(samples[0].camera);
  const png = await bytes(`/samples/${samples[0].file}`);
  const bitmap = await createImageBitmap(new Blob([png]));
  const canvas = new OffscreenCanvas(224, 224);
  const context = canvas.getContext("2d");
  context.drawImage(bitmap, 0, 0, 224, 224);
  const pixels = context.getImageData(0, 0, 224, 224);

  const { depthMap } = await localiser.localise(pixels, camera, { depthMap: true });
  const values = new Float32Array(3 * 224 * 224);
  const [mean, std] = [[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]];
  for (let channel = 0; channel < 3; channel++) {
    for (let pixel = 0; pixel < 224 * 224; pixel++) {
      values[channel * 224 * 224 + pixel] = (pixels.data[4 * pixel + channel] / 255 - mean[channel]) / std[channel];
    }
  }
  /** Heatmap and depth map. */
  let runPeer = async () => [[], depthMap.values];
  if (peer) {
    const ort = await import(device === "cpu" ? "/ort/ort.wasm.min.mjs" : "/ort/ort.webgpu.min.mjs");
    ort.env.wasm.numThreads = 1;
    ort.env.wasm.wasmPaths = "/ort/";
    const session = await ort.InferenceSession.create(await bytes(`/models/${name}.onnx`), { executionProviders: [device === "cpu" ? "wasm" : "webgpu"] });
    const feeds = { x: new ort.Tensor("float32", values, [1, 3, 224, 224]) };
    runPeer = async () => Object.values(await session.run(feeds)).map((tensor) => tensor.data);
  }

  const contestants = {
    ours: () => localiser.localise(pixels, camera),
    file: () => localiser.localise(png, camera),
    theirs: runPeer,
  };
  const outputs = await runPeer();
  const largest = Math.max(...outputs[1]);
  const difference = Math.max(...depthMap.values.map((depth, index) => Math.abs(depth - outputs[1][index]))) / largest;

  const times = { ours: [], file: [], theirs: [] };
  const once = async (run) => {
    const begin = performance.now();
    await run();
    return performance.now() - begin;
  };
  const end = performance.now() + milliseconds;
  do {
    for (const [contestant, run] of Object.entries(contestants)) {
      await once(run);
      for (let turn = 0; turn < 5; turn++) times[contestant].push(await once(run));
    }
  } while (performance.now() < end);
  const median = (list) => list.sort((a, b) => a - b)[list.length >> 1];
  return {
    ours: median(times.ours),
    theirs: median(times.theirs),
    file: median(times.file),
    ran: localiser.deviceName,
    runs: times.ours.length,
    difference,
  };
}
