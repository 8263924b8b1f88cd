/** The same as a tracker gives it, as two flights. */
export const followed = (frames) => ({
  explained: null,
  frames: frames.map(({ at }, frame) => ({ frame, time: frame / 30, repeated: false, image: frame > 14 && frame < 20 ? null : at, radiusPx: 4.5, confidence: 0.97, outlier: false })),
});

/** A ball that is thrown before a still camera. */

/** Six metres before the origin, a metre above the ground. */
export const filming = { width: 160, height: 120, intrinsic: [[200, 0, 79.5], [0, 200, 59.5], [0, 0, 1]], camera_from_world: [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 6], [0, 0, 0, 1]] };

/** A ball that is thrown before a still camera: pixels, and the film's own time. */
export function film(frames = 40) {
  const [width, height] = [160, 120];
  return Array.from({ length: frames }, (_, frame) => {
    const data = new Uint8ClampedArray(width * height * 4);
    const [x, y] = [12 + 3.2 * frame, 90 - 4.2 * frame + 0.11 * frame * frame];
    for (let at = 0; at < width * height; at++) {
      const [column, row] = [at % width, Math.floor(at / width)];
      const texture = ((column * 7 + row * 13) % 31) + (Math.floor(column / 9) + Math.floor(row / 7)) % 17;
      const inside = Math.min(1, Math.max(0, 4.5 - Math.hypot(column - x, row - y)));
      const colour = [90 + texture, 110 + texture, 80 + texture].map((level, channel) => level + inside * ([230, 240, 60][channel] - level));
      data.set([...colour, 255], 4 * at);
    }
    return { picture: { data, width, height }, at: [x, y] };
  });
}
