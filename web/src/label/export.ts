/** Labels as files that the command line reads: clips.jsonl with its pictures, and 2D tracks. */
import { isRepeated, timeOf } from "../shared/clip";
import type { StoredClip } from "../shared/workspace";

/** What the page uses of the File System Access API, which not every browser has. */
interface FolderHandle {
  getDirectoryHandle(name: string, options: { create: boolean }): Promise<FolderHandle>;
  getFileHandle(name: string, options: { create: boolean }): Promise<{
    getFile(): Promise<File>;
    createWritable(): Promise<{ write(content: Blob | string): Promise<void>; close(): Promise<void> }>;
  }>;
}

type Picker = (options: { id: string; mode: "readwrite" }) => Promise<FolderHandle>;

/** The browser's picker of folders, where it has one. */
export function folderPicker(): Picker | undefined {
  const picker = (window as { showDirectoryPicker?: Picker }).showDirectoryPicker;
  return picker && ((options) => picker.call(window, options));
}

/** One line of a clips.jsonl; frames that nobody has looked at, or that repeat another, are left out. Throws in words without a camera. */
export function lineOf(clip: StoredClip): string {
  if (!clip.camera) throw new Error(`${clip.id} has no camera yet, and clips.jsonl needs one. Set one, or save the track (CSV), which needs none.`);
  const frames = looked(clip).map((frame) => {
    const label = clip.labels[frame];
    const world = clip.truth?.[frame];
    return {
      file: fileOf(clip, frame),
      t: timeOf(clip, frame),
      ...(label ? { image: label } : {}),
      visible: Boolean(label),
      ...(world ? { world } : {}),
    };
  });
  const { id, fps, camera, scene } = clip;
  return `${JSON.stringify({ id, fps, camera, scene, frames })}\n`;
}

/** `Frame,Visibility,X,Y`, the common format of 2D ball trackers; with the frames' times where they are a video's own. */
export function csvOf(clip: StoredClip): string {
  const lines = looked(clip).map((frame) => {
    const label = clip.labels[frame];
    const line = label ? `${frame},1,${label.map((value) => value.toFixed(3)).join(",")}` : `${frame},0,0,0`;
    return clip.timesKnown ? `${line},${timeOf(clip, frame).toFixed(6)}` : line;
  });
  return [`Frame,Visibility,X,Y${clip.timesKnown ? ",Time" : ""}`, ...lines, ""].join("\n");
}

/** A clip's name as a name of files. */
export function nameOf({ id }: StoredClip): string {
  return id.replace(/[^\p{L}\p{N}.-]+/gu, "_");
}

/** Writes pictures and clips.jsonl; a line of another clip that is there stays. */
export async function writeFolder(folder: FolderHandle, clip: StoredClip, onFrame: (done: number, all: number) => void): Promise<void> {
  const frames = looked(clip);
  const pictures = await folder.getDirectoryHandle(nameOf(clip), { create: true });
  for (const [done, frame] of frames.entries()) {
    onFrame(done, frames.length);
    await write(pictures, fileOf(clip, frame).split("/")[1] ?? "", clip.pictures[frame] ?? new Blob());
  }
  const before = await (await (await folder.getFileHandle("clips.jsonl", { create: true })).getFile()).text();
  const others = before.split("\n").filter((line) => line.trim() !== "" && idOf(line) !== clip.id);
  await write(folder, "clips.jsonl", [...others, lineOf(clip)].join("\n"));
}

async function write(folder: FolderHandle, name: string, content: Blob | string): Promise<void> {
  const file = await (await folder.getFileHandle(name, { create: true })).createWritable();
  await file.write(content);
  await file.close();
}

function idOf(line: string): unknown {
  try {
    return (JSON.parse(line) as { id?: unknown }).id;
  } catch {
    return undefined;
  }
}

function looked(clip: StoredClip): number[] {
  return clip.labels.flatMap((label, frame) => (label === undefined || isRepeated(clip, frame) ? [] : [frame]));
}

function fileOf(clip: StoredClip, frame: number): string {
  const kind = clip.pictures[frame]?.type.split("/")[1] ?? "png";
  return `${nameOf(clip)}/${String(frame).padStart(3, "0")}.${kind === "jpeg" ? "jpg" : kind}`;
}
