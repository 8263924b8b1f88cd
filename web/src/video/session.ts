/** Work on a video that is kept: in the browser the last one, with the video where there is room; as files as many as one likes. */
import type { Camera, Scene } from "gravisight";
import { del, get, set } from "idb-keyval";
import type { TrackRecord } from "./track-result";
import type { Correction } from "./tracking";

const LAST = "video session";
const FORMAT = "gravisight-session";
const VERSION = 1;
/** A larger video is not kept with the work: it has to be opened again. Bytes; browsers grant a page far more. */
const LARGEST_KEPT = 512 * 2 ** 20;
/** As many bytes of a video's start as tell it from all others. */
const READ = 2 ** 20;

/** Which video it is of. */
export interface VideoIdentity {
  name: string;
  /** Bytes. */
  size: number;
  /** SHA-256 of the first MiB, hexadecimal; empty where the browser computes none (a page that did not come over HTTPS). */
  sha256: string;
}

export interface Session {
  format: typeof FORMAT;
  version: typeof VERSION;
  /** When it was kept, ISO 8601. */
  saved: string;
  video: VideoIdentity & { width: number; height: number; durationMs: number };
  camera?: Camera;
  cameraSigma: Camera[];
  /** Where the camera comes from, in words. */
  cameraFrom: string;
  /** What was assumed of the camera, in words; empty where nothing was. */
  cameraNote: string;
  scene?: Scene;
  sport: string;
  court?: string;
  corrections: Correction[];
  threshold: number;
  record: TrackRecord;
}

/** The last session with its video, if that was kept. */
export interface Kept {
  session: Session;
  file?: File;
}

export async function identityOf(file: File): Promise<VideoIdentity> {
  const { name, size } = file;
  // Absent where the page did not come over HTTPS.
  if (!globalThis.crypto?.subtle) return { name, size, sha256: "" };
  const digest = await crypto.subtle.digest("SHA-256", await file.slice(0, READ).arrayBuffer());
  return { name, size, sha256: [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("") };
}

/** Whether two are the same video; by its content where that is known of both, else by its name. */
export function isSameVideo(a: VideoIdentity, b: VideoIdentity): boolean {
  if (a.size !== b.size) return false;
  return a.sha256 && b.sha256 ? a.sha256 === b.sha256 : a.name === b.name;
}

export function sessionOf(content: Omit<Session, "format" | "version" | "saved">): Session {
  return { format: FORMAT, version: VERSION, saved: new Date().toISOString(), ...content };
}

/** Keeps a session in place of the last one, and its video if the browser has room. */
export async function keepSession(session: Session, file: File | undefined): Promise<void> {
  if (file && file.size <= LARGEST_KEPT) {
    try {
      return await set(LAST, { session, file } satisfies Kept);
    } catch {
      // No room for the video: the work alone is small.
    }
  }
  await set(LAST, { session } satisfies Kept);
}

export async function keptSession(): Promise<Kept | undefined> {
  return get<Kept>(LAST).catch(() => undefined);
}

export async function forgetSession(): Promise<void> {
  await del(LAST);
}

/** Whether a file's content is a session. */
export function isSession(content: unknown): boolean {
  return typeof content === "object" && content !== null && (content as { format?: unknown }).format === FORMAT;
}

/** A session that was read from a file; throws in words. */
export function checkedSession(content: unknown, name: string): Session {
  const session = content as Session;
  if (session.version !== VERSION) throw new Error(`${name} was saved by another version of this page (format ${String(session.version)}; this page reads ${VERSION}).`);
  const frames = session.record?.tracked?.frames;
  const isWhole = Array.isArray(frames) && frames.length > 0 && session.record.timesMs?.length === frames.length && session.record.tracked.findings && session.video?.name;
  if (!isWhole) throw new Error(`${name} is damaged: it contains no track of a video.`);
  return session;
}
