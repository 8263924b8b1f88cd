/** What the steps hand to each other: camera, scene, clips. Kept in this browser; survives a reload. */
import type { Camera, CourtSearch, Scene } from "gravisight";
import { del, get, keys, set } from "idb-keyval";

/** A clip: its pictures as files, and what was labelled so far. */
export interface StoredClip {
  id: string;
  /** Name of the video that it is of, or of its first picture; undefined of what was drawn here. */
  file?: string;
  /** Frames a second, on average. */
  fps: number;
  /** Of its pictures, pixels; where it is not here, it is the camera's. */
  size?: { width: number; height: number };
  /** Undefined where nobody has calibrated it: then the clip can be labelled, but not learned from. */
  camera?: Camera;
  /** The place and the ball; undefined where nobody has chosen them. */
  scene?: Scene;
  /** The sport whose scene it is; empty of another one. */
  sport?: string;
  /** One picture (PNG, JPEG or WebP) a frame. */
  pictures: Blob[];
  /** Seconds, one a frame: of a video those that its file gives. */
  times: number[];
  /** Whether every frame of the video is there, with its own time. */
  timesKnown?: boolean;
  /** When the frames were filmed, seconds, where that was found to differ: of a video that was filmed at another rate than it is shown at. */
  filmed?: number[];
  /** Whether a frame shows the picture of the one before again: it teaches nothing. One a frame, where it is known. */
  repeated?: boolean[];
  /** One a frame: pixels; null where the ball is not to be seen; undefined where nobody has looked yet. */
  labels: ([number, number] | null | undefined)[];
  /** 3D truth, metres, where it is known (synthetic clips): only to score with. */
  truth?: [number, number, number][];
  /** Whether it is for scoring, not for learning. */
  heldOut: boolean;
}

/** What a camera is of. */
export interface CameraAbout {
  /** Where it comes from, such as `calibrated on a frame of rally.mp4`. */
  from: string;
  /** Names of the videos and pictures that it is the camera of; empty where nobody knows. */
  of: string[];
  /** The court that it was found by, where it was. */
  court?: string;
  /** When it was set, ISO 8601. */
  at: string;
}

/** A picture to calibrate on, and who asks. */
export interface CalibrationWish {
  picture: Blob;
  name: string;
  /** The video or picture that it is of. */
  of: string;
  /** A sport whose court it may show; empty where none is known. */
  sport: string;
  /** What was already found in the picture. */
  search?: CourtSearch;
  /** The step to go back to with the camera. */
  back: string;
}

/** The paper's court without its obstacles: gravity and a floor, a ball of 40 cm. */
const SCENE: Scene = {
  gravity: [0, 0, -9.81],
  ball: { radius: 0.2 },
  contact: { model: "bounce", restitution: 0.8, friction: 0.2 },
  floor: { height: 0 },
};

const CLIP = "clip ";

/** Fires `camera`, `scene` and `clips` when they change, `calibrate` when a picture is to be calibrated on. */
class Workspace extends EventTarget {
  /** Until the step Calibrate takes it. */
  wish: CalibrationWish | undefined;

  /** Opens the step Calibrate with a picture. */
  calibrate(wish: CalibrationWish): void {
    this.wish = wish;
    this.dispatchEvent(new Event("calibrate"));
    location.hash = "calibrate";
  }

  get camera(): Camera | undefined {
    return parsed("gravisight.camera");
  }

  /** Sets the camera, how unsure it is (`oneSigma` of its calibration), and what it is of. */
  setCamera(camera: Camera | undefined, oneSigma: Camera[], about?: Omit<CameraAbout, "at">): void {
    store("gravisight.camera", camera);
    store("gravisight.camera-sigma", camera && oneSigma);
    store("gravisight.camera-about", camera && about && { ...about, at: new Date().toISOString() });
    this.dispatchEvent(new Event("camera"));
  }

  /** Undefined of one that an earlier version of the page kept. */
  get cameraAbout(): CameraAbout | undefined {
    return parsed("gravisight.camera-about");
  }

  /** The camera is also the one of another video. */
  cameraIsOf(name: string): void {
    const about = this.cameraAbout ?? { from: "from the step Calibrate", of: [], at: new Date().toISOString() };
    store("gravisight.camera-about", { ...about, of: [...new Set([...about.of, name])] });
    this.dispatchEvent(new Event("camera"));
  }

  get cameraSigma(): Camera[] {
    return parsed("gravisight.camera-sigma") ?? [];
  }

  get scene(): Scene {
    return this.ownScene ?? SCENE;
  }

  /** The one that was set; undefined where none was. */
  get ownScene(): Scene | undefined {
    return parsed("gravisight.scene");
  }

  set scene(scene: Scene | undefined) {
    store("gravisight.scene", scene);
    this.dispatchEvent(new Event("scene"));
  }

  /** Ids of the clips that are kept, in order. */
  async clips(): Promise<string[]> {
    const all = await keys<string>();
    return all.filter((key) => key.startsWith(CLIP)).map((key) => key.slice(CLIP.length)).sort();
  }

  async clip(id: string): Promise<StoredClip | undefined> {
    return get<StoredClip>(CLIP + id);
  }

  /** Keeps a clip, in place of the one with its id. Throws where the browser has no room. */
  async keep(clip: StoredClip): Promise<void> {
    await set(CLIP + clip.id, clip);
    this.dispatchEvent(new Event("clips"));
  }

  async forget(id: string): Promise<void> {
    await del(CLIP + id);
    this.dispatchEvent(new Event("clips"));
  }
}

export const workspace = new Workspace();

function parsed<T>(key: string): T | undefined {
  try {
    return (JSON.parse(localStorage.getItem(key) ?? "null") as T | null) ?? undefined;
  } catch {
    return undefined;
  }
}

function store(key: string, value: unknown): void {
  try {
    if (value === undefined) localStorage.removeItem(key);
    else localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // a browser that keeps nothing: the page works until it is closed
  }
}
