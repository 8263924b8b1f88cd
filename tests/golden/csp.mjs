// The map of a small `csp` backbone as TensorFlow.js computes it, for src/model/tests.rs.
//
// Set-up:  npm install --prefix FOLDER @tensorflow/tfjs
// Use:     NODE_PATH=FOLDER/node_modules node tests/golden/csp.mjs          (writes csp.safetensors beside this script)
//
// Weights and picture come from the formula of pen.py, by tensor name.
import { writeFileSync } from "node:fs";
import { createRequire } from "node:module";

const tf = createRequire(import.meta.url)("@tensorflow/tfjs");
const [HEIGHT, WIDTH] = [64, 96];
const [STEM, STAGES, BLOCKS, PYRAMID] = [4, [4, 6, 8, 10], [1, 2, 2, 1], 6];
const MASK = (1n << 64n) - 1n;

/** `count` numbers in [-1, 1): SplitMix64 over FNV-1a of the name. */
function values(name, count) {
  let state = 0xcbf29ce484222325n;
  for (const byte of Buffer.from(name)) state = ((state ^ BigInt(byte)) * 0x100000001b3n) & MASK;
  return Array.from({ length: count }, (_, index) => {
    let z = (state + BigInt(index + 1) * 0x9e3779b97f4a7c15n) & MASK;
    z = ((z ^ (z >> 30n)) * 0xbf58476d1ce4e5b9n) & MASK;
    z = ((z ^ (z >> 27n)) * 0x94d049bb133111ebn) & MASK;
    z ^= z >> 31n;
    return Number(z >> 11n) / 2 ** 52 - 1;
  });
}

/** As pen.py's `tensor`, in its order of axes. */
function tensor(name, shape) {
  const small = name.endsWith("last.weight") && shape[1] < 64 ? 0.05 : 1;
  const scale = shape.length === 4 ? small * Math.sqrt(6 / (shape[1] * shape[2] * shape[3])) : undefined;
  const made = values(name, shape.reduce((a, b) => a * b, 1)).map((x) => {
    if (scale !== undefined) return scale * x;
    if (name.endsWith("running_var")) return 1 + 0.5 * x;
    return name.endsWith(".weight") ? 1 + 0.2 * x : 0.1 * x;
  });
  return tf.tensor(made, shape);
}

/** A convolution padded by half its kernel, as PyTorch pads. */
function convolved(x, name, [inputs, outputs], kernel, stride, biased = true) {
  const weight = tensor(`${name}.weight`, [outputs, inputs, kernel, kernel]).transpose([2, 3, 1, 0]);
  const pad = Math.floor(kernel / 2);
  const y = tf.conv2d(tf.pad(x, [[0, 0], [pad, pad], [pad, pad], [0, 0]]), weight, stride, "valid");
  return biased ? y.add(tensor(`${name}.bias`, [outputs])) : y;
}
const leaky = (x) => tf.leakyRelu(x, 0.1);

const picture = tf.tensor(values("picture", 3 * HEIGHT * WIDTH), [1, 3, HEIGHT, WIDTH]).transpose([0, 2, 3, 1]);
let x = leaky(convolved(picture, "backbone.body.stem", [3, STEM], 3, 2));
x = tf.maxPool(tf.pad(x, [[0, 0], [1, 1], [1, 1], [0, 0]], -1e9), 3, 2, "valid");
let inputs = STEM;
const maps = STAGES.map((width, stage) => {
  const name = `backbone.body.stages.${stage}`;
  const first = leaky(convolved(x, `${name}.first`, [inputs, width], 3, stage === 0 ? 1 : 2));
  let made = first;
  for (let block = 0; block < BLOCKS[stage]; block++) {
    const of = `${name}.blocks.${block}`;
    const half = leaky(convolved(made, `${of}.first`, [width, width / 2], 3, 1));
    made = tf.concat([leaky(convolved(half, `${of}.second`, [width / 2, width / 2], 3, 1)), half], 3);
  }
  x = tf.concat([leaky(convolved(made, `${name}.last`, [width, width], 3, 1)), first], 3);
  inputs = 2 * width;
  return convolved(x, `backbone.laterals.${stage}`, [inputs, PYRAMID], 1, 1);
});
let top = maps.pop();
while (maps.length) {
  const fine = maps.pop();
  top = tf.image.resizeBilinear(top, fine.shape.slice(1, 3), false, true).add(fine);
}
const fused = convolved(top, "backbone.fuse.conv", [PYRAMID, PYRAMID], 3, 1, false);
const norm = (field) => tensor(`backbone.fuse.norm.${field}`, [PYRAMID]);
const feature = tf.relu(tf.batchNorm(fused, norm("running_mean"), norm("running_var"), norm("bias"), norm("weight"), 1e-5));

const data = Buffer.from(Float32Array.from(feature.dataSync()).buffer);
let header = JSON.stringify({ feature: { dtype: "F32", shape: feature.shape, data_offsets: [0, data.length] } });
header = header.padEnd(Math.ceil(header.length / 8) * 8);
const length = Buffer.alloc(8);
length.writeBigUInt64LE(BigInt(header.length));
writeFileSync(new URL("csp.safetensors", import.meta.url), Buffer.concat([length, Buffer.from(header), data]));
