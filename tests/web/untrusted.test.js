/** Models from a server that means no good: the package in Node.js, where files of the machine are within reach. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { after, before, test } from "node:test";
import { Localiser } from "gravisight";
import { samples } from "./support/demo.js";

const card = JSON.parse(readFileSync(new URL("../../models/sd-l.json", import.meta.url), "utf8"));
const { camera } = samples[0];
/** What the server sends, by path. */
const answers = {};
let server, url;

before(async () => {
  server = createServer((request, response) => answers[request.url](response));
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  url = `http://127.0.0.1:${server.address().port}`;
});

after(() => {
  server.closeAllConnections();
  server.close();
});

const json = (content) => (response) => response.setHeader("Content-Type", "application/json").end(JSON.stringify(content));

/** Sends until the other end has enough; how much that was, bytes. */
function endless(sent) {
  return (response) => {
    response.setHeader("Content-Type", "application/octet-stream");
    const more = () => {
      while (!response.destroyed && response.write(Buffer.alloc(1 << 20))) sent.bytes += 1 << 20;
      if (!response.destroyed) response.once("drain", more);
    };
    more();
  };
}

async function refused(path, words) {
  await assert.rejects(Localiser.create({ model: url + path, camera }), (thrown) => {
    assert.equal(thrown.name, "GravisightError");
    assert.match(thrown.message, words);
    return true;
  });
}

test("a card from a server names no file of this machine", async () => {
  answers["/file.json"] = json({ ...card, weights: new URL("../../models/sd-l.safetensors", import.meta.url).href });
  await refused("/file.json", /may only name weights on a network/);
  answers["/data.json"] = json({ ...card, weights: "data:application/octet-stream;base64,AAAA" });
  await refused("/data.json", /may only name weights on a network/);
});

test("a redirect to another kind of address is not followed", async () => {
  answers["/moved.json"] = (response) => response.writeHead(302, { Location: "file:///etc/hostname" }).end();
  await refused("/moved.json", /Could not fetch the model's card/);
});

test("a card without an end, and weights without one, are not heard to their end", { timeout: 120_000 }, async () => {
  const sent = { bytes: 0 };
  answers["/endless.json"] = endless(sent);
  await refused("/endless.json", /more than 1 MB/);
  assert.ok(sent.bytes < 1 << 26, `${sent.bytes} bytes`);
  answers["/large.json"] = json({ ...card, weights: "large.safetensors" });
  answers["/large.safetensors"] = endless(sent);
  await refused("/large.json", /more than 256 MB/);
});

test("weights that are announced as too large are not fetched", async () => {
  answers["/announced.json"] = json({ ...card, weights: "announced.safetensors" });
  answers["/announced.safetensors"] = (response) => response.writeHead(200, { "Content-Length": String(2 ** 40), "Content-Type": "application/octet-stream" }).write("a");
  await refused("/announced.json", /more than 256 MB/);
});

test("weights that are not the card's are refused by their sha256", async () => {
  answers["/other.json"] = json({ ...card, weights: "other.safetensors" });
  const weights = readFileSync(new URL("../../models/sd-l.safetensors", import.meta.url));
  weights[weights.length - 1] ^= 1;
  answers["/other.safetensors"] = (response) => response.setHeader("Content-Type", "application/octet-stream").end(weights);
  await refused("/other.json", /sha256/);
});
