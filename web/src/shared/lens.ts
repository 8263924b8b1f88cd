/** What a photograph or a video itself says of its lens. */

/** 35 mm equivalents that lenses have, mm. */
const [LEAST, MOST] = [5, 3000];
/** Apple's key in a QuickTime file. */
const QUICKTIME = "com.apple.quicktime.camera.focal_length.35mm_equivalent";

/** 35 mm equivalent of the focal length in mm, where a picture's EXIF data has it. */
export async function focalOfPicture(file: Blob): Promise<number | undefined> {
  try {
    const { parse } = await import("exifr");
    const found = (await parse(file, ["FocalLengthIn35mmFormat"])) as { FocalLengthIn35mmFormat?: unknown } | undefined;
    return sensible(found?.FocalLengthIn35mmFormat);
  } catch {
    // A file without such data, or of another kind: nothing is known.
    return undefined;
  }
}

/** The same of a video, where its QuickTime metadata has it. */
export async function focalOfVideo(file: Blob): Promise<number | undefined> {
  const { BlobSource, Input, MP4, QTFF } = await import("mediabunny");
  const input = new Input({ source: new BlobSource(file), formats: [MP4, QTFF] });
  try {
    return numberOf((await input.getMetadataTags()).raw?.[QUICKTIME]);
  } catch {
    return undefined;
  } finally {
    input.dispose();
  }
}

/** A tag's value: text, or big-endian bytes of an integer or a float. */
function numberOf(value: unknown): number | undefined {
  if (typeof value === "string") return sensible(Number(value));
  if (!(value instanceof Uint8Array)) return undefined;
  const integer = sensible(value.reduce((sum, byte) => 256 * sum + byte, 0));
  return integer ?? (value.length === 4 ? sensible(new DataView(value.buffer, value.byteOffset).getFloat32(0)) : undefined);
}

function sensible(value: unknown): number | undefined {
  return typeof value === "number" && value >= LEAST && value <= MOST ? value : undefined;
}
