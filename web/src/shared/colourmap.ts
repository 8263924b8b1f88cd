/** Viridis, which is perceptually uniform and safe for the colour-blind: ten equal steps of matplotlib's table. */
const STOPS = [
  0x440154, 0x482475, 0x414487, 0x355f8d, 0x2a788e, 0x21918c, 0x22a884, 0x44bf70, 0x7ad151, 0xbddf26, 0xfde725,
];
const LEVELS = 256;

const table = Uint8ClampedArray.from({ length: LEVELS * 3 }, (_, index) => {
  const position = (Math.floor(index / 3) / (LEVELS - 1)) * (STOPS.length - 1);
  const below = Math.min(Math.floor(position), STOPS.length - 2);
  const shift = 16 - 8 * (index % 3);
  const channel = (stop: number | undefined) => ((stop ?? 0) >> shift) & 0xff;
  const fraction = position - below;
  return channel(STOPS[below]) * (1 - fraction) + channel(STOPS[below + 1]) * fraction;
});

/** Paints values as pixels: `from` is dark, `to` is bright; `alpha` (of 0..1) says how opaque a level is. */
export function pixelsOf(
  values: ArrayLike<number>,
  width: number,
  height: number,
  range: { from: number; to: number },
  alpha: (level: number) => number,
): ImageData {
  const image = new ImageData(width, height);
  const span = range.to - range.from || 1;
  for (let i = 0; i < width * height; i++) {
    const level = Math.min(Math.max(((values[i] ?? 0) - range.from) / span, 0), 1);
    const row = 3 * Math.round(level * (LEVELS - 1));
    image.data.set([table[row]!, table[row + 1]!, table[row + 2]!, 255 * alpha(level)], 4 * i);
  }
  return image;
}

/** The smallest and the largest of the values. */
export function rangeOf(values: ArrayLike<number>): { from: number; to: number } {
  let from = Infinity;
  let to = -Infinity;
  for (let i = 0; i < values.length; i++) {
    from = Math.min(from, values[i]!);
    to = Math.max(to, values[i]!);
  }
  return { from, to };
}
