/** Makes videos of pictures. A browser's recorder would put the frames where its own clock puts them. */

/**
 * A WebM file of `pictures` (PNGs as base64). Like a recorder's, it does not tell how long it is, but where a frame `spoilt` is named: that one is noise,
 * and a player that has to find the end out would stop at it. `page` comes from a server.
 */
export async function film(page, { pictures, fps, width, height, spoilt }) {
  const chunks = await page.evaluate(encode, { pictures, fps, width, height });
  const blocks = chunks.map(({ key, bytes }, index) => {
    const head = Buffer.from([0x81, 0, 0, key ? 0x80 : 0]); // track 1, milliseconds, flags
    head.writeInt16BE(Math.round((1000 * index) / fps), 1);
    const content = Buffer.from(bytes, "base64");
    return element(0xa3, head, index === spoilt ? content.map((_, at) => (at * 2654435761) >>> 24) : content);
  });
  const size = element(0xe0, element(0xb0, number(width)), element(0xba, number(height)));
  const track = [element(0xd7, number(1)), element(0x73c5, number(1)), element(0x83, number(1)), element(0x86, Buffer.from("V_VP9")), size];
  const duration = Buffer.alloc(8);
  duration.writeDoubleBE((1000 * pictures.length) / fps);
  const length = spoilt === undefined ? [] : [element(0x4489, duration)];
  return Buffer.concat([
    element(0x1a45dfa3, element(0x4282, Buffer.from("webm")), element(0x4287, number(2)), element(0x4285, number(2))),
    element(
      0x18538067,
      element(0x1549a966, element(0x2ad7b1, number(1_000_000)), ...length),
      element(0x1654ae6b, element(0xae, ...track)),
      element(0x1f43b675, element(0xe7, number(0)), ...blocks),
    ),
  ]);
}

/** An element of EBML, the format below WebM: what it is, its length, its content. */
function element(id, ...content) {
  const body = Buffer.concat(content);
  const name = Buffer.from(id.toString(16), "hex");
  const length = Buffer.alloc(8);
  length.writeBigUInt64BE((1n << 56n) | BigInt(body.length));
  return Buffer.concat([name, length, body]);
}

function number(value) {
  const bytes = Buffer.alloc(4);
  bytes.writeUInt32BE(value);
  return bytes;
}

// Runs in the page.
async function encode({ pictures, fps, width, height }) {
  const chunks = [];
  const encoder = new VideoEncoder({
    output(chunk) {
      const bytes = new Uint8Array(chunk.byteLength);
      chunk.copyTo(bytes);
      chunks.push({ key: chunk.type === "key", bytes: btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join("")) });
    },
    error(thrown) {
      throw thrown;
    },
  });
  encoder.configure({ codec: "vp09.00.10.08", width, height, bitrate: 8e6 });
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d");
  context.imageSmoothingEnabled = false;
  for (const [index, picture] of pictures.entries()) {
    const bitmap = await createImageBitmap(new Blob([Uint8Array.from(atob(picture), (c) => c.charCodeAt(0))]));
    context.drawImage(bitmap, 0, 0, width, height);
    const frame = new VideoFrame(canvas, { timestamp: Math.round((1e6 * index) / fps) });
    encoder.encode(frame, { keyFrame: index % 15 === 0 });
    frame.close();
  }
  await encoder.flush();
  return chunks;
}
