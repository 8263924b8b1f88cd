/** Every frame of a video file, decoded one after the other: none is left out, however busy the computer is. */
import { BlobSource, CanvasSink, EncodedPacketSink, Input, MATROSKA, MP4, QTFF, WEBM, type InputVideoTrack, type WrappedCanvas } from "mediabunny";
import { messageOf } from "../dom";

/** Frames decoded ahead of the one that is looked at. */
const AHEAD = 4;

/** A frame as it is to be shown: turned, with square pixels. */
export interface DecodedFrame {
  picture: HTMLCanvasElement | OffscreenCanvas;
  /** The same. */
  image: HTMLCanvasElement | OffscreenCanvas;
  timeMs: number;
}

export class DecodedVideo {
  /** Why not all frames came; empty where they did. */
  broken = "";
  readonly #name: string;
  readonly #input: Input;
  readonly #track: InputVideoTrack;
  readonly #sink: CanvasSink;

  private constructor(name: string, input: Input, track: InputVideoTrack, sink: CanvasSink) {
    this.#name = name;
    this.#input = input;
    this.#track = track;
    this.#sink = sink;
  }

  /** Undefined where this browser or this file cannot be decoded so (no WebCodecs, another container or codec, transparency): it has to be played. */
  static async open(file: File): Promise<DecodedVideo | undefined> {
    if (typeof VideoDecoder !== "function") return undefined;
    const input = new Input({ source: new BlobSource(file), formats: [MP4, QTFF, WEBM, MATROSKA] });
    try {
      const track = await input.getPrimaryVideoTrack();
      // Transparency would be decoded in a Worker made of a text, which this page forbids.
      if (track && (await track.canDecode()) && !(await track.canBeTransparent())) {
        const sink = new CanvasSink(track, { poolSize: AHEAD });
        if (await sink.getCanvas(await track.getFirstTimestamp())) return new DecodedVideo(file.name, input, track, sink);
      }
    } catch {
      // What the player makes of it decides.
    }
    input.dispose();
    return undefined;
  }

  /** In order of time. A frame is valid until the next one is requested. */
  async *frames(): AsyncGenerator<DecodedFrame> {
    let last: number | undefined;
    let count = 0;
    const shown = ({ canvas, timestamp }: WrappedCanvas): DecodedFrame => {
      last = timestamp;
      count++;
      return { picture: canvas, image: canvas, timeMs: 1000 * timestamp };
    };
    try {
      for await (const decoded of this.#sink.canvases()) yield shown(decoded);
    } catch (thrown) {
      // The decoder drops what it has decoded ahead: up to the frame that is broken, each is decoded by itself.
      try {
        for (const timestamp of await this.#timestamps()) {
          const decoded = last === undefined || timestamp > last ? await this.#sink.getCanvas(timestamp) : null;
          if (decoded) yield shown(decoded);
        }
      } catch {
        // The broken frame.
      }
      if (last === undefined) throw new Error(`${this.#name} cannot be decoded: ${messageOf(thrown)}`);
      this.broken = `The video is broken after ${last.toFixed(2)} s: ${messageOf(thrown)} The page uses only the frames of ${this.#name} before that.`;
      return;
    }
    const all = (await this.#timestamps()).length;
    if (last !== undefined && all > count + 1) this.broken = `${this.#name} is cut off after ${last.toFixed(2)} s: only ${count} of its ${all} frames can be read.`;
  }

  /** When the frames are shown, seconds, in that order, as far as the file can be read. A file holds them in the order of decoding. */
  async #timestamps(): Promise<number[]> {
    const timestamps: number[] = [];
    try {
      for await (const { timestamp } of new EncodedPacketSink(this.#track).packets(undefined, undefined, { metadataOnly: true })) timestamps.push(timestamp);
    } catch {
      // Those before the break are known.
    }
    return timestamps.sort((a, b) => a - b);
  }

  close(): void {
    this.#input.dispose();
  }
}
