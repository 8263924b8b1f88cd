/** A video with what was found drawn into it: ring, trail, time and speed. */
import { BufferTarget, canEncodeVideo, CanvasSource, Mp4OutputFormat, Output, QUALITY_HIGH, WebMOutputFormat, type VideoCodec } from "mediabunny";
import { contextOf, make } from "../dom";
import type { Watch } from "../shared/job";
import { drawFound, drawTrail, write } from "../shared/marks";
import { DecodedVideo } from "../shared/decoded";
import { fittedAt } from "./report";
import type { TrackResult } from "./track-result";

/** The likeliest to play elsewhere first. */
const CODECS = ["avc", "vp9", "vp8"] as const satisfies VideoCodec[];
/** Of a ring that is not to be trusted. */
const DIM = 0.4;
/** Of the picture's shorter side: marks are drawn for one of so many pixels. */
const DRAWN_FOR = 540;
const TEXT = "600 16px system-ui, sans-serif";

/** Throws in words where the browser cannot decode or encode it. */
export async function overlayVideo(file: File, result: TrackResult, threshold: number, { signal, progress }: Watch): Promise<{ blob: Blob; extension: "mp4" | "webm" }> {
  const decoded = await DecodedVideo.open(file);
  if (!decoded) throw new Error("This browser cannot decode the video frame by frame. Use Chrome, Edge or the command gravisight track --overlay.");
  const canvas = make("canvas");
  let output: Output | undefined;
  let source: CanvasSource | undefined;
  const { timesMs } = result.record;
  try {
    let count = 0;
    let codec: VideoCodec | undefined;
    for await (const frame of decoded.frames()) {
      signal.throwIfAborted();
      const image = frame.image as HTMLCanvasElement | OffscreenCanvas;
      if (!output) {
        // H.264 has even sides only.
        [canvas.width, canvas.height] = [image.width & ~1, image.height & ~1];
        codec = await encodable(canvas.width, canvas.height);
        output = new Output({ format: codec === "avc" ? new Mp4OutputFormat() : new WebMOutputFormat(), target: new BufferTarget() });
        source = new CanvasSource(canvas, { codec, bitrate: QUALITY_HIGH });
        output.addVideoTrack(source);
        await output.start();
      }
      draw(canvas, image, frame.timeMs, result, threshold);
      const start = timesMs[count] ?? frame.timeMs;
      const end = timesMs[count + 1] ?? 2 * start - (timesMs[count - 1] ?? start - 1000 / 30);
      await source?.add((start - (timesMs[0] ?? 0)) / 1000, (end - start) / 1000);
      progress(++count, timesMs.length);
    }
    source?.close();
    await output?.finalize();
    const buffer = (output?.target as BufferTarget | undefined)?.buffer;
    if (!buffer) throw new Error("The video has no frames.");
    const extension = codec === "avc" ? "mp4" : "webm";
    return { blob: new Blob([buffer], { type: `video/${extension}` }), extension };
  } catch (thrown) {
    await output?.cancel().catch(() => undefined);
    throw thrown;
  } finally {
    decoded.close();
  }
}

async function encodable(width: number, height: number): Promise<VideoCodec> {
  for (const codec of CODECS) if (await canEncodeVideo(codec, { width, height })) return codec;
  throw new Error("This browser cannot encode a video of this size. Use Chrome, Edge or the command gravisight track --overlay.");
}

function draw(canvas: HTMLCanvasElement, image: CanvasImageSource, timeMs: number, result: TrackResult, threshold: number): void {
  const context = contextOf(canvas);
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.drawImage(image, 0, 0);
  const scale = Math.min(canvas.width, canvas.height) / DRAWN_FOR;
  context.scale(scale, scale);
  const toCanvas = ([u, v]: [number, number]): [number, number] => [(u + 0.5) / scale, (v + 0.5) / scale];
  drawTrail(context, result.trail(timeMs).map((detection) => toCanvas(detection.image)));
  const found = result.at(timeMs);
  if (!found) return;
  context.globalAlpha = found.confidence >= threshold ? 1 : DIM;
  drawFound(context, toCanvas(found.image));
  context.globalAlpha = 1;
  context.font = TEXT;
  const fit = fittedAt(result.curve, found.filmed);
  const speed = fit?.explained ? `   ${fit.speed.toFixed(1)} m/s (${(3.6 * fit.speed).toFixed(0)} km/h)` : "";
  write(context, `${found.filmed.toFixed(2)} s${speed}`, [12, canvas.height / scale - 12], "#ffffff");
}
