/** Why a browser cannot play a video, in words: what the file holds, and what to do. */
import { BlobSource, Input, MATROSKA, MP4, QTFF, WEBM } from "mediabunny";

/** Names for people, by the library's. */
const NAMES: Record<string, string> = { hevc: "HEVC (H.265)", av1: "AV1", vp9: "VP9", vp8: "VP8", avc: "H.264" };

/** Undefined where nothing can be learned about the file. */
export async function whyUnplayable(file: File): Promise<string | undefined> {
  const input = new Input({ source: new BlobSource(file), formats: [MP4, QTFF, WEBM, MATROSKA] });
  try {
    const track = await input.getPrimaryVideoTrack();
    if (!track && (await input.getPrimaryAudioTrack())) return `${file.name} has sound, but no pictures.`;
    if (!track) return `${file.name} contains no readable video: it may be cut off or damaged. Copy it again from the camera.`;
    const codec = track.codec && (NAMES[track.codec] ?? track.codec);
    if (!codec) return `${file.name} contains a video format that this browser cannot play. Convert it to H.264: ${conversion(file.name)}`;
    const phone = track.codec === "hevc" ? " On an iPhone, choose Settings → Camera → Formats → Most Compatible before you film." : "";
    return `${file.name} is ${codec} video, which this browser cannot play.${phone} Convert it to H.264: ${conversion(file.name)}`;
  } catch {
    return undefined;
  } finally {
    input.dispose();
  }
}

function conversion(name: string): string {
  return `ffmpeg -i "${name}" -c:v libx264 converted.mp4`;
}
