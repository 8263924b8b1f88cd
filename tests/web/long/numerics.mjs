/** What a wasm build makes of the pictures of `cargo bench --bench all -- numerics `: `node numerics.mjs FOLDER BUILD` writes `wasm-BUILD.safetensors` there. */
import { readFileSync, writeFileSync } from "node:fs";

const [folder, build] = process.argv.slice(2);
const root = new URL("../../../", import.meta.url);
const read = (path) => readFileSync(new URL(path, root));

const module = await import(new URL(`pkg/wasm/${build}/gravisight.js`, root));
await module.default({ module_or_path: read(`pkg/wasm/${build}/gravisight_bg.wasm`) });
const localiser = await module.Localiser.create(read("models/any.json").toString(), read("models/any.safetensors"), "cpu");
const camera = read("benches/common/numerics.camera.json").toString();
// As in benches/numerics.rs.
const asked = { ballRadius: 0.11, heatmap: true, depthMap: true };

const file = readFileSync(`${folder}/pictures.safetensors`);
const start = 8 + Number(file.readBigUInt64LE(0));
const { pictures } = JSON.parse(file.subarray(8, start));
const [count, height, width] = pictures.shape;
const found = { heatmap: [], depth: [], world: [], sigma: [] };
for (let index = 0; index < count; index++) {
  const from = start + pictures.data_offsets[0] + index * width * height * 3;
  const data = new Uint8Array(4 * width * height).fill(255);
  for (let at = 0; at < width * height; at++) for (let channel = 0; channel < 3; channel++) data[4 * at + channel] = file[from + 3 * at + channel];
  const { heatmap, depthMap, world, depthSigma: sigma } = await localiser.localise({ data, width, height }, camera, asked);
  found.heatmap.push(heatmap.values);
  found.depth.push(depthMap.values);
  found.world.push(Float32Array.from(world));
  found.sigma.push(Float32Array.of(sigma));
}

const header = {};
const parts = [];
let end = 0;
for (const [name, values] of Object.entries(found)) {
  const bytes = values.map(({ buffer, byteOffset, byteLength }) => Buffer.from(buffer, byteOffset, byteLength));
  const length = bytes.reduce((sum, { length }) => sum + length, 0);
  header[name] = { dtype: "F32", shape: [count, values[0].length], data_offsets: [end, (end += length)] };
  parts.push(...bytes);
}
const head = Buffer.from(JSON.stringify(header));
const size = Buffer.alloc(8);
size.writeBigUInt64LE(BigInt(head.length));
writeFileSync(`${folder}/wasm-${build}.safetensors`, Buffer.concat([size, head, ...parts]));
