/** Every documented option of the npm package has an effect: one that is lost between layers fails here. */
import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";
import { fileURLToPath } from "node:url";
import { Adapter, coreFiles, FineTuner, Localiser, Toolbox, Track, VideoTracker } from "gravisight";
import { drawnCourt, seatedCamera } from "./support/court.js";
import { pictureOf, samples } from "./support/demo.js";
import { writeStubBuilds } from "./support/stub-builds.js";
import { film, filming, followed } from "./support/throw.js";

const root = fileURLToPath(new URL("../..", import.meta.url));
const { camera } = samples[0];
const picture = pictureOf(samples[0]);
const ball = { radius: 0.2 };
const ANY = new URL("../../models/any.json", import.meta.url);

/** The package's sources, by name. */
const sources = Object.fromEntries(readdirSync(`${root}/pkg/src`).map((name) => [name, readFileSync(`${root}/pkg/src/${name}`, "utf8")]));
const CORE_TYPES = readFileSync(`${root}/pkg/wasm/cpu/gravisight.d.ts`, "utf8");
/** Those whose fields were looked at. */
const covered = new Set();

/** The fields that an exported interface itself has, as its declaration says. */
function fieldsOf(name, text = Object.values(sources).find((source) => source.includes(`export interface ${name} `))) {
  const found = text?.match(new RegExp(`export interface ${name}\\b[^{]*\\{([\\s\\S]*?)\\n?\\}\\n`));
  assert.ok(found, `no interface ${name}`);
  if (text !== CORE_TYPES) covered.add(name);
  return [...found[1].matchAll(/^(?: {2}| {4})(\w+)\??:/gm)].map(([, field]) => field);
}

/** Runs a check for each field, and refuses fields without a check and checks without a field. */
async function each(fields, checks) {
  assert.deepEqual(Object.keys(checks).sort(), [...new Set(fields)].sort());
  for (const [field, check] of Object.entries(checks)) assert.ok(await check(), `\`${field}\` has no effect`);
}

const far = (a, b, least = 1e-3) => Math.hypot(...a.map((value, axis) => value - b[axis])) > least;
const aborted = (promise) => promise.then(() => false, (thrown) => thrown === "enough");
const enough = AbortSignal.abort("enough");
const code = (promise) => promise.then(() => "none", (thrown) => thrown.code);
/** The core's options, where a checked value shows that it arrived. */
const CORE = {
  wasm: async (create) => (await code(create({ wasm: "/nowhere" }))) === "cpu-build-missing",
  threads: async (create) => (await code(create({ threads: 0 }))) === "threads",
  // On the calling thread, where this test's own build reports that it starts; or in another.
  worker: async (create) => {
    const startsHere = async (worker) => {
      let starts = 0;
      const stub = { start: () => starts++ };
      globalThis.stub = { cpu: stub, "cpu-relaxed": stub };
      const made = await create({ worker, wasm: `file://${writeStubBuilds()}/` }).catch(({ code }) => code);
      if (typeof made === "object") made.dispose();
      delete globalThis.stub;
      return starts;
    };
    return (await startsHere(false)) === 1 && (await startsHere(true)) === 0;
  },
  signal: (create) => aborted(create({ signal: enough })),
  onProgress: async (create) => {
    const stages = [];
    (await create({ onProgress: ({ stage }) => stages.push(stage) })).dispose();
    return stages.includes("wasm");
  },
};
const MODEL = {
  ...CORE,
  model: async (create) => (await code(create({ model: "/nowhere.json" }))) === "fetch",
  device: async (create) => (await code(create({ device: "abacus" }))) === "device",
  cache: async (create) => (await keptBy(() => create({ cache: true }))) > 0 && (await keptBy(() => create({ cache: false }))) === 0,
};

/** How many files something keeps in a Cache API, which Node.js has not. */
async function keptBy(create) {
  let kept = 0;
  const cache = { match: async () => undefined, put: async () => void kept++, keys: async () => [] };
  globalThis.caches = { open: async () => cache };
  try {
    (await create()).dispose();
  } finally {
    delete globalThis.caches;
  }
  return kept;
}
const with_ = (checks, create) => Object.fromEntries(Object.entries(checks).map(([field, check]) => [field, () => check(create)]));
const OF_CORE = fieldsOf("CoreOptions");
const OF_MODEL = [...OF_CORE, ...fieldsOf("ModelOptions")];

test("Localiser.create", async () => {
  const create = (options) => Localiser.create({ camera, ball, ...options });
  await each([...OF_MODEL, ...fieldsOf("CreateOptions")], {
    ...with_(MODEL, create),
    camera: async () => (await code((await Localiser.create({ ball })).localise(picture))) === "camera-missing",
    ball: async () => (await code((await Localiser.create({ camera })).localise(picture))) === "value",
  });
});

test("Localiser.localise", async () => {
  const localiser = await Localiser.create({ camera, ball });
  const plain = await localiser.localise(picture);
  const farther = JSON.parse(JSON.stringify(camera));
  farther.camera_from_world[0][3] += 1;
  // The ball is above the floor; a place that begins far above it cannot hold it.
  const tools = await Toolbox.create();
  const floor = { ...(await tools.scene("floor")), ball: { ...(await tools.scene("floor")).ball, radius: 0.2 } };
  const aloft = { ...floor, bounds: { low: [-900, -900, 800], high: [900, 900, 900] } };
  const fields = [...fieldsOf("LocaliseOptions"), ...fieldsOf("Wanted", CORE_TYPES).filter((field) => field !== "ballRadius")];
  await each(fields, {
    ball: async () => Math.abs((await localiser.localise(picture, { ball: { radius: 0.4 } })).depth / plain.depth - 2) < 0.1,
    camera: async () => far((await localiser.localise(picture, { camera: farther })).world, plain.world, 0.5),
    saliency: async () => (await localiser.localise(picture, { saliency: true })).saliency.values.length > 0,
    signal: () => aborted(localiser.localise(picture, { signal: enough })),
    heatmap: async () => (await localiser.localise(picture, { heatmap: true })).heatmap.values.length > 0,
    depthMap: async () => (await localiser.localise(picture, { depthMap: true })).depthMap.values.length > 0,
    region: async () => {
      const [x, y] = plain.image;
      const region = { left: x > 112 ? 0 : 160, top: y > 112 ? 0 : 160, width: 64, height: 64 };
      return far((await localiser.localise(picture, { region })).image, plain.image, 20);
    },
    scene: async () => {
      const found = await localiser.localise(picture, { scene: aloft });
      return plain.ballFound && !found.ballFound && found.notes.some((note) => note.includes("outside the volume"));
    },
    candidates: async () => (await localiser.localise(picture, { candidates: 3 })).candidates.length > 1,
    cameraSigma: async () => (await localiser.localise(picture, { cameraSigma: [farther] })).depthSigma >= plain.depthSigma && far((await localiser.localise(picture, { cameraSigma: [farther] })).covariance[0], plain.covariance[0]),
    truth: async () => Math.abs((await localiser.localise(picture, { truth: plain.world })).dtg) < 1e-6,
  });
  // Frames that could not be read count for nothing, however many were under way at a time.
  const unreadable = [40, 50].map((timestampMs) => localiser.localiseVideoFrame(new Uint8Array([1, 2, 3]), timestampMs));
  assert.equal(await code(localiser.localiseVideoFrame(picture, 45)), "timestamp-order");
  assert.deepEqual(await Promise.all(unreadable.map(code)), ["image-decode", "image-decode"]);
  assert.equal((await localiser.localiseVideoFrame(picture, 40)).timestampMs, 40);
  assert.equal(await code(localiser.localiseVideoFrame(picture, 40)), "timestamp-order");
  localiser.startVideo();
  assert.equal((await localiser.localiseVideoFrame(picture, 0)).timestampMs, 0);
  // Without a ball the scene's counts; what is no scene is refused in words.
  const without = await Localiser.create({ camera });
  assert.ok(Math.abs((await without.localise(picture, { scene: floor })).depth - plain.depth) < 1e-9);
  for (const scene of [{}, 3]) assert.equal(await code(without.localise(picture, { scene })), "format");
  for (const each of [localiser, without, tools]) each.dispose();
});

test("VideoTracker: every option, frames that are not awaited, frames that fail", async () => {
  const frames = film();
  const size = { width: 160, height: 120 };
  const create = (options) => VideoTracker.create(options);
  const watched = async (options = {}) => {
    const tracker = await create(options);
    // None of these is awaited, and one buffer is used again: each frame is as it was.
    const shared = { ...size, data: new Uint8ClampedArray(frames[0].picture.data.length) };
    const added = [];
    for (const [frame, { picture }] of frames.entries()) {
      shared.data.set(picture.data);
      added.push(tracker.add(shared, frame * 33));
    }
    await Promise.all(added);
    return tracker;
  };
  const tracker = await watched();
  const plain = await tracker.track();
  assert.equal(plain.frames.length, frames.length);
  const off = plain.frames.map(({ image }, frame) => image && Math.hypot(image[0] - frames[frame].at[0], image[1] - frames[frame].at[1])).filter((each) => each !== null);
  assert.ok(off.length > 20 && off.sort((a, b) => a - b)[Math.floor(off.length / 2)] < 2, `${off.length} frames: ${off}`);
  await each([...OF_MODEL, ...fieldsOf("VideoTrackerOptions")], {
    ...with_(MODEL, create),
    camera: async () => (await code((await create({ camera: { ...filming, width: 400 } })).add(frames[0].picture, 0))) === "camera-mismatch",
    scene: async () => (await code((await create({ scene: "abracadabra", camera: filming })).track())) === "value",
    ball: async () => {
      const wrong = await create({ scene: "floor", camera: filming, ball: { radius: -1 } });
      await wrong.add(frames[0].picture, 0);
      // An option that is undefined is none.
      return (await code(wrong.track())) !== "none" && (await code(wrong.track({ ball: undefined }))) !== "none";
    },
    config: async () => {
      const used = async (config) => (await (await create({ config })).track()).config;
      const printed = { tracklets: { min_gain: 9 } };
      const [own, likewise] = [await used({ ...plain.config, tracklets: { ...plain.config.tracklets, minGain: 9 } }), await used(printed)];
      assert.deepEqual(own, likewise);
      const wrong = await create({ config: { tracklets: { gate: 0 } } });
      return own.tracklets.minGain === 9 && (await code(wrong.add(frames[0].picture, 0))) === "value";
    },
    court: async () => {
      const added = async (options) => code((await create(options)).add(frames[0].picture, 0));
      // That of a scene is none where its lines are not known.
      return (await added({ court: "squash" })) === "calibration" && (await added({ scene: "squash" })) === "none" && (await added({ court: "tennis" })) === "none";
    },
  });
  const place = { camera: filming, scene: "floor", ball: { radius: 0.1 } };
  const inMetres = await tracker.track(place);
  assert.equal(typeof inMetres.explained, "boolean");
  const none = { frame: 20, image: [5, 5] };
  const seen = { frame: 20, image: frames[20].at };
  await each(fieldsOf("TrackVideoOptions").concat("camera", "scene", "ball"), {
    camera: async () => (await code(tracker.track({ scene: "floor" }))) === "camera-missing",
    scene: async () => (await code(tracker.track({ camera: filming }))) === "scene-missing",
    ball: async () => {
      const heights = async (radius) => (await tracker.track({ ...place, ball: { radius } })).frames.map(({ world }) => world?.[1] ?? 0);
      return far(await heights(0.1), await heights(0.2), 0.1);
    },
    seeds: async () => {
      const unused = async (seeds) => (await tracker.track({ seeds })).verdict.includes("these marks were ignored");
      // Of two in one frame the last counts.
      return (await unused([none])) && !(await unused([none, seen])) && (await unused([seen, none]));
    },
    cameraSigma: async () => (await code(tracker.track({ ...place, cameraSigma: [{ ...filming, width: -1 }] }))) !== "none",
    cameraAssumed: async () => (await code(tracker.track({ ...place, cameraAssumed: "maybe" }))) !== "none",
    hits: async () => (await code(tracker.track({ ...place, hits: -1 }))) !== "none",
    timesKnown: async () => (await code(tracker.track({ ...place, timesKnown: "maybe" }))) !== "none",
    signal: () => aborted(tracker.track({ signal: enough })),
    onProgress: async () => {
      const parts = [];
      await tracker.track({ ...place, onProgress: ({ stage, total }) => parts.push([stage, total]) });
      return parts.length > 0 && parts[0][0] === "fit";
    },
  });
  const other = await create();
  const broken = { width: 160, height: 120, data: new Uint8ClampedArray(7) };
  const calls = [other.add(frames[0].picture, 0), other.add(broken, 33), other.add(frames[1].picture, 33), other.add(frames[2].picture, 33)];
  const codes = await Promise.all(calls.map(code));
  assert.deepEqual([codes[0], codes[2], codes[3]], ["none", "none", "timestamp-order"]);
  assert.notEqual(codes[1], "none");
  for (const each of [tracker, other]) each.dispose();
});

/** A throw before that camera: sightings of 30 frames, 40 a second. */
async function thrown(toolbox) {
  const times = Array.from({ length: 30 }, (_, frame) => frame / 40);
  const { states } = await toolbox.forecast(await toolbox.scene("floor"), { position: [0, 0, 1], velocity: [0.5, 0.2, 2] }, times);
  // A click is a third of a pixel off.
  const images = await toolbox.project(filming, states.map(([x, y, z]) => [x, y, z]));
  return images.map(([x, y], frame) => ({ time: times[frame], image: [x + (frame % 3 ? 0.3 : -0.3), y + (frame % 2 ? 0.3 : -0.3)] }));
}
/** The camera, another metre away. */
const moved = { ...filming, camera_from_world: filming.camera_from_world.map((row, index) => (index === 2 ? [0, 1, 0, 6.5] : row)) };
const sigmaOf = ({ frames }) => frames[15].sigma;

test("Track", async () => {
  const toolbox = await Toolbox.create();
  const scene = await toolbox.scene("floor");
  const seen = await thrown(toolbox);
  const filled = async (options, more = () => ({})) => {
    const own = await Track.create({ camera: filming, scene, toolbox, ...options });
    for (const [frame, { time, image }] of seen.entries()) own.add({ timestampMs: 1000 * time, image, confidence: frame < 8 ? 0.4 : 1, ...more(frame) });
    return own;
  };
  const fit = async (...given) => (await filled(...given)).fit();
  const plain = await fit();
  const used = ({ frames }) => frames.filter(({ residualPx }) => residualPx).length;
  await each(fieldsOf("TrackOptions"), {
    camera: async () => far((await fit({ camera: moved })).frames[15].world, plain.frames[15].world, 0.1),
    scene: async () => (await code(fit({ scene: { ...scene, gravity: "down" } }))) === "format",
    cameraSigma: async () => sigmaOf(await fit({ cameraSigma: [moved] })) > 1.5 * sigmaOf(plain),
    cameraAssumed: async () => !(await fit({ cameraSigma: [moved] })).explained && (await fit({ cameraSigma: [moved], cameraAssumed: true })).explained,
    leastConfidence: async () => used(await fit({ leastConfidence: 0.3 })) >= used(plain) + 8,
    noisePx: async () => sigmaOf(await fit({ noisePx: 4 })) > sigmaOf(plain),
    estimate: async () => (await code(fit({ estimate: ["mass"] }))) === "format",
    window: async () => (await filled({ window: 12 })).length === 12,
    toolbox: async () => {
      (await filled()).dispose();
      return (await toolbox.courts()).length > 3;
    },
  });
  // A tenth larger than a ball 6 m away is.
  const radiusPx = (1.1 * filming.intrinsic[0][0] * scene.ball.radius) / 6;
  const sized = (radiusSigmaPx) => fit({}, () => ({ radiusPx, ...(radiusSigmaPx && { radiusSigmaPx }) }));
  await each(fieldsOf("Sighting"), {
    timestampMs: async () => Math.abs((await fit({}, (frame) => ({ timestampMs: 5000 + 25 * frame }))).frames[0].time - 5) < 1e-9,
    image: async () => used(await fit({}, (frame) => (frame > 20 ? { image: null } : {}))) < used(plain),
    confidence: async () => used(await fit({}, () => ({ confidence: 1 }))) > used(plain),
    radiusPx: async () => far((await sized()).frames[15].world, plain.frames[15].world),
    radiusSigmaPx: async () => far((await sized(0.01)).frames[15].world, (await sized(3)).frames[15].world),
  });
  assert.ok(await aborted((await filled()).fit({ signal: enough })));
  toolbox.dispose();
});

/** A phone that is assumed, and a ball in a circle: every option of both. */
async function assumesAndPlaces(toolbox) {
  const size = { width: 4000, height: 3000 };
  const plain = await toolbox.assumedCamera(size);
  assert.equal(plain.oneSigma.length, plain.assumptions.length);
  const assumed = async (known) => (await toolbox.assumedCamera({ ...size, ...known })).camera;
  await each(fieldsOf("CameraToAssume", CORE_TYPES), {
    width: async () => (await assumed({ width: 4400 })).width === 4400,
    height: async () => (await assumed({ height: 3300 })).height === 3300,
    focal35mm: async () => Math.abs((await assumed({ focal35mm: 52 })).intrinsic[0][0] / plain.camera.intrinsic[0][0] - 2) < 1e-9,
    heightAboveGround: async () => Math.abs((await assumed({ heightAboveGround: 2 })).camera_from_world[1][3] - 2) < 1e-9,
    video: async () => (await assumed({ video: true })).intrinsic[0][0] > plain.camera.intrinsic[0][0],
  });
  assert.equal(await code(assumed({ focal35mm: 0 })), "value");
  const circle = { centre: [2200, 1300], radiusPx: 100 };
  const ball = { radius: 0.11 };
  const placed = (other, options) => toolbox.ballAt(plain.camera, { ...circle, ...other }, ball, options);
  const found = await placed();
  // A ball of 11 cm is 100 px of 3005 px: some 3.3 m away.
  assert.ok(Math.abs(found.depth - 3.33) < 0.03, `${found.depth} m`);
  await each(fieldsOf("DrawnCircle", CORE_TYPES), {
    centre: async () => far((await placed({ centre: [2300, 1300] })).world, found.world, 0.05),
    radiusPx: async () => Math.abs((await placed({ radiusPx: 50 })).depth / found.depth - 2) < 0.01,
    sigmaPx: async () => Math.abs((await placed({ sigmaPx: 3 })).sigma / found.sigma - 3) < 1e-6,
    picture: async () => Math.abs((await placed({ centre: [1099.75, 649.75], radiusPx: 50, picture: { width: 2000, height: 1500 } })).depth / found.depth - 1) < 1e-6,
  });
  await each(fieldsOf("BallAtOptions"), {
    cameraSigma: async () => (await placed({}, { cameraSigma: plain.oneSigma })).depthSigma > 2 * found.depthSigma,
    signal: () => aborted(placed({}, { signal: enough })),
  });
  assert.equal(await code(placed({ radiusPx: 0 })), "value");
  assert.equal(await code(toolbox.ballAt(plain.camera, circle, { radius: 11 })), "value");
}

const POINTS = { width: 1920, height: 1080, court: "tennis", names: ["near doubles corner left", "near doubles corner right", "far doubles corner left", "far doubles corner right"], image: [[312.5, 905], [1630, 897.5], [601, 322], [1297, 319.5]] };

test("Toolbox", async () => {
  await each(OF_CORE, with_(CORE, (options) => Toolbox.create(options)));
  const toolbox = await Toolbox.create();
  const plain = await toolbox.calibrate(POINTS);
  const calibrated = async (points, options) => (await toolbox.calibrate({ ...POINTS, ...points }, options)).camera;
  await each(fieldsOf("CalibrateOptions"), {
    estimate: async () => (await code(toolbox.calibrate(POINTS, { estimate: ["colour"] }))) === "value",
    // One of something else.
    picture: async () => (await code(toolbox.calibrate(POINTS, { picture }))) !== "none",
    signal: () => aborted(toolbox.calibrate(POINTS, { signal: enough })),
  });
  const { points, lines } = await toolbox.court("tennis");
  await each(fieldsOf("FindCourtOptions"), {
    estimate: async () => (await code(toolbox.findCourt(picture, "tennis", { estimate: ["colour"] }))) === "value",
    signal: () => aborted(toolbox.findCourt(picture, "tennis", { signal: enough })),
  });
  await findsCourts(toolbox, drawnCourt(lines));
  const intrinsic = [[1700, 0, 959.5], [0, 1700, 539.5], [0, 0, 1]];
  await each(fieldsOf("CalibrationPoints"), {
    width: async () => (await calibrated({ width: 1930 })).width === 1930,
    height: async () => (await calibrated({ height: 1090 })).height === 1090,
    intrinsic: async () => (await calibrated({ intrinsic })).intrinsic[0][0] === 1700,
    distortion: async () => (await calibrated({ intrinsic, distortion: { k1: 0.05 } })).distortion?.k1 === 0.05,
    image: async () => far((await calibrated({ image: POINTS.image.map(([x, y]) => [x + 30, y]) })).camera_from_world.flat(), plain.camera.camera_from_world.flat()),
    world: async () => {
      const { court, names, ...rest } = POINTS;
      const world = names.map((name) => points[name]);
      return !far((await toolbox.calibrate({ ...rest, world })).camera.camera_from_world.flat(), plain.camera.camera_from_world.flat());
    },
    court: async () => (await code(calibrated({ court: "quidditch" }))) === "calibration",
    names: async () => (await code(calibrated({ names: ["goal", ...POINTS.names.slice(1)] }))) === "value",
    lines: async () => (await code(calibrated({ lines: [{ from: [0, 0, 0] }] }))) === "format",
    sigma_px: async () => (await toolbox.calibrate({ ...POINTS, sigma_px: 20 })).sigma.focalPx > 3 * plain.sigma.focalPx,
  });
  const scene = await toolbox.scene("floor");
  const frames = await thrown(toolbox);
  const fit = (options) => toolbox.fitTrack(frames, { camera: filming, scene, ...options });
  const fitted = await fit();
  await each(fieldsOf("FitTrackOptions"), {
    camera: async () => far((await fit({ camera: moved })).frames[15].world, fitted.frames[15].world, 0.1),
    scene: async () => (await code(fit({ scene: { ...scene, gravity: "down" } }))) === "format",
    noisePx: async () => sigmaOf(await fit({ noisePx: 4 })) > sigmaOf(fitted),
    estimate: async () => (await code(fit({ estimate: ["mass"] }))) === "format",
    cameraSigma: async () => sigmaOf(await fit({ cameraSigma: [moved] })) > 1.5 * sigmaOf(fitted),
    cameraAssumed: async () => !(await fit({ cameraSigma: [moved] })).explained && (await fit({ cameraSigma: [moved], cameraAssumed: true })).explained,
    signal: () => aborted(fit({ signal: enough })),
  });
  await assumesAndPlaces(toolbox);
  const shown = async (options) => JSON.stringify(await toolbox.simulator({ environment: 1, ...options }));
  await each(fieldsOf("SimulatorOptions"), {
    environment: async () => (await shown({ environment: 2 })) !== (await shown({})),
    camera: async () => (await shown({ camera: 2 })) !== (await shown({})),
  });
  toolbox.dispose();
  assert.match((await coreFiles("cpu", { wasm: `file://${writeStubBuilds()}` })).join(), /gravisight-stub-/);
});

/** A drawn court is found, its camera comes again from its points, and a picture without one is no error. */
async function findsCourts(toolbox, picture) {
  const { found, calibration, reason } = await toolbox.findCourt(picture, "tennis");
  assert.deepEqual([found.verdict, found.court, reason], ["sure", "tennis", ""]);
  assert.ok(found.probability > 0.95 && found.lines.every(({ isSeen }) => isSeen), found.reason);
  assert.ok(Math.abs(calibration.camera.intrinsic[0][0] / seatedCamera.intrinsic[0][0] - 1) < 0.01);
  const [any, blank] = [await toolbox.findCourt(picture, "auto"), { ...picture, data: new Uint8ClampedArray(picture.data.length).fill(90) }];
  assert.equal(any.found.court, "tennis");

  const places = Object.entries((await toolbox.court("tennis")).points);
  const images = await toolbox.project(found.camera, places.map(([, place]) => place));
  const isShown = ([x, y]) => x >= 0 && y >= 0 && x < picture.width && y < picture.height;
  const placed = places.map(([name], index) => ({ name, at: images[index] })).filter(({ at }) => at && isShown(at));
  const { width, height } = picture;
  const points = { width, height, court: "tennis", names: placed.map(({ name }) => name), image: placed.map(({ at }) => at), sigma_px: found.sigmaPx };
  const again = await toolbox.calibrate(points, { picture });
  for (const [a, b] of [[again.centre, calibration.centre], [again.sigma.centre, calibration.sigma.centre]]) assert.ok(!far(a, b, 1e-5), `${a} is not ${b}`);

  const none = await toolbox.findCourt(blank, "tennis");
  assert.deepEqual([none.found.verdict, none.found.camera, none.calibration], ["none", null, null]);
  assert.ok(none.reason.length > 10 && none.reason.endsWith(none.found.reason), none.reason);
}

test("FineTuner", async () => {
  const create = (options) => FineTuner.create({ model: ANY, ...options });
  const settings = fieldsOf("FineTuneOptions", CORE_TYPES);
  fieldsOf("FineTuneOptions");
  const refused = (field) => async () => (await code(create({ [field]: field === "supervision" ? "guesswork" : -1 }))) !== "none";
  await each([...OF_MODEL, ...settings], { ...with_(MODEL, create), ...Object.fromEntries(settings.map((field) => [field, refused(field)])) });

  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 2 });
  const { fps, frames } = await simulator.clip(7, 0);
  const drawn = [];
  for (const { t, image, world } of frames.slice(0, 24)) drawn.push({ picture: await simulator.picture(world), t, image, world });
  const clip = { id: "one", fps, camera: simulator.camera, scene: simulator.scene, frames: drawn };
  const settled = { steps: 3, batch: 1, crop: 64 };
  const adding = async (changes, options) => {
    const tuner = await create(settled);
    const added = await tuner.addClip({ ...clip, ...changes }, options).catch(({ code }) => code);
    return { tuner, added };
  };
  const withFrames = async (change) => (await adding({ frames: drawn.map(change) })).added;
  const { tuner, added } = await adding();
  assert.ok(added.frames > 0, added.leftOut);
  await each(fieldsOf("AddClipOptions"), {
    // Without a clip to score with there is nothing to say.
    heldOut: async () => {
      const { tuner: scoring } = await adding({}, { heldOut: true });
      return (await code(scoring.evaluate())) === "none" && (await code(tuner.evaluate())) !== "none";
    },
    signal: () => aborted(tuner.addClip(clip, { signal: enough })),
  });
  await each(fieldsOf("TrainingClip"), {
    id: async () => (await (await FineTuner.resume(await tuner.checkpoint())).progress()).awaited[0].id === "one",
    fps: async () => (await adding({ fps: -1 })).added === "value",
    camera: async () => typeof (await adding({ camera: { ...clip.camera, width: -1 } })).added === "string",
    scene: async () => (await adding({ scene: { ...clip.scene, gravity: "down" } })).added === "format",
    frames: async () => (await adding({ frames: drawn.slice(0, 12) })).added.frames < added.frames,
  });
  const scored = async (change) => {
    const { tuner: scoring } = await adding({ frames: drawn.map(change) }, { heldOut: true });
    return (await scoring.evaluate()).dtg;
  };
  await each(fieldsOf("TrainingFrame"), {
    picture: async () => (await withFrames((frame) => ({ ...frame, picture: new Uint8Array([1, 2, 3]) }))) === "image-decode",
    t: async () => typeof (await withFrames((frame) => ({ ...frame, t: 1 }))) === "string",
    image: async () => !(await withFrames((frame) => ({ ...frame, image: null }))).frames,
    world: async () => JSON.stringify(await scored((frame) => frame)) !== JSON.stringify(await scored(({ world, ...frame }) => frame)),
  });
  const steps = [];
  await each(fieldsOf("StepOptions"), {
    signal: () => aborted(tuner.step(1, { signal: enough })),
    onStep: async () => (await tuner.step(1, { onStep: ({ step }) => steps.push(step) })).step === 1 && steps.length === 1,
  });
  assert.ok(await aborted(tuner.evaluate({ signal: enough })));
  const camera = clip.camera;
  assert.ok(await aborted(tuner.localise(drawn[0].picture, { camera, signal: enough })));
  const found = await tuner.localise(drawn[0].picture, { camera, ball, heatmap: true });
  assert.ok(found.heatmap.values.length > 0);

  const checkpoint = await tuner.checkpoint();
  const resume = (options) => FineTuner.resume(checkpoint, options);
  await each([...OF_CORE, ...fieldsOf("FineTuneResumeOptions")], {
    ...with_(CORE, resume),
    device: async () => (await code(resume({ device: "abacus" }))) === "device",
    cache: () => MODEL.cache((options) => resume({ device: "auto", ...options })),
  });
  tuner.dispose();
  toolbox.dispose();
});

test("Adapter", async () => {
  const create = (options) => Adapter.create({ model: ANY, ...options });
  const settings = fieldsOf("AdaptOptions", CORE_TYPES);
  fieldsOf("AdaptOptions");
  const refused = (field) => async () => (await code(create({ [field]: -1 }))) !== "none";
  await each([...OF_MODEL, ...settings], { ...with_(MODEL, create), ...Object.fromEntries(settings.map((field) => [field, refused(field)])) });

  const frames = film();
  const track = followed(frames);
  const unsure = { ...track, frames: track.frames.map((frame) => ({ ...frame, confidence: 0.6 })) };
  const adapter = await create({ steps: 1 });
  await each(fieldsOf("AdaptBeginOptions"), {
    seeds: async () => (await adapter.begin(unsure, { seeds: [{ frame: 3, image: frames[3].at }] })).flights > (await adapter.begin(unsure)).flights,
    // A picture of another shape than the camera's; a radius that no ball has.
    camera: async () => (await adapter.begin(track, { camera: { ...filming, height: 60 }, ball }), (await code(adapter.add(frames[0].picture, 0))) === "camera-mismatch"),
    ball: async () => (await code(adapter.begin(track, { ball: { radius: -1 } }))) === "value",
    signal: () => aborted(adapter.begin(track, { signal: enough })),
  });
  assert.deepEqual(await adapter.begin(track), { flights: 2, frames: 35 });
  assert.ok(await aborted(adapter.add(frames[0].picture, 0, { signal: enough })));
  const given = await create({ steps: 1 });
  await given.begin(track);
  for (const [frame, { picture }] of frames.entries()) await given.add(picture, (1000 * frame) / 30);
  assert.equal(await code(given.add(frames[0].picture, 1)), "timestamp-order");
  assert.ok(await aborted(given.end({ signal: enough })));
  await given.end();
  assert.equal(await code(given.checkpoint()), "value");
  const steps = [];
  await each(fieldsOf("AdaptStepOptions"), {
    signal: () => aborted(given.step(1, { signal: enough })),
    onStep: async () => (await given.step(1, { onStep: ({ network }) => steps.push(network) })).step === 1 && steps[0] === "detector",
  });
  const { step, steps: all } = await given.progress();
  assert.ok(step === 1 && all >= 2, `${step} of ${all}`);
  assert.ok(await aborted(given.finish("ball", { signal: enough })));

  const checkpoint = await given.checkpoint();
  const resume = (options) => Adapter.resume(checkpoint, options);
  await each([...OF_CORE, ...fieldsOf("FineTuneResumeOptions")], {
    ...with_(CORE, resume),
    device: async () => (await code(resume({ device: "abacus" }))) === "device",
    cache: () => MODEL.cache((options) => resume({ device: "auto", ...options })),
  });
  // The frames of another film are not those of the run.
  const other = await resume({});
  await other.begin({ ...track, frames: track.frames.slice(0, 30) });
  for (const [frame, { picture }] of frames.slice(0, 30).entries()) await other.add(picture, (1000 * frame) / 30);
  await other.end();
  assert.equal(await code(other.step()), "data");
  for (const made of [adapter, given, other]) made.dispose();
});

test("no interface of options was left out", () => {
  const named = Object.values(sources).flatMap((source) => [...source.matchAll(/export interface (\w+Options) /g)].map(([, name]) => name));
  // How a call crosses inside the package.
  assert.deepEqual([...named].filter((name) => !covered.has(name) && name !== "CallOptions"), []);
});

/** The codes that a piece of source or text names, patterns written out. */
function codesIn(literals) {
  const names = [...sources["connect.ts"].match(/type JsonName = (.*);/)[1].matchAll(/"(\w+)"/g)].map(([, name]) => name);
  const patterns = { "${name}": names, "${JsonName}": names, "${kind}": ["cpu", "webgpu"] };
  const written = literals.flatMap((literal) => {
    const pattern = Object.keys(patterns).find((each) => literal.includes(each));
    return pattern ? patterns[pattern].map((name) => literal.replace(pattern, name)) : [literal];
  });
  return [...new Set(written)].sort();
}

test("the error codes that are thrown, those of the type and those of the README are the same", () => {
  const all = Object.values(sources).join("\n");
  // The code is a literal, or one of two.
  const thrown = [...all.matchAll(/new GravisightError\((?:\s*\w+ \? (["`][^"`]+["`]) :)?\s*(["`][^"`]+["`])/g)].flatMap(([, one, other]) => [one, other]);
  const unread = [...all.matchAll(/new GravisightError\(([^,]*),/g)].map(([, code]) => code).filter((code) => !/["`]/.test(code));
  // What the core has thrown, and what crossed from a Worker.
  assert.deepEqual(unread.sort(), ["String(thrown.code)", "message.code"]);
  const literals = thrown.filter(Boolean).map((literal) => literal.slice(1, -1));
  const declared = [...sources["error.ts"].match(/FacadeErrorCode =([\s\S]*?);/)[1].matchAll(/\| ["`]([^"`]+)["`]/g)].map(([, literal]) => literal);
  const readme = readFileSync(`${root}/pkg/README.md`, "utf8");
  const [own, core] = readme.match(/The codes of this package:([\s\S]*?)The core adds its own:([\s\S]*?)\n## /).slice(1);
  const listed = (table) => [...table.matchAll(/^\| (`[^|]*) \|/gm)].flatMap(([, cell]) => [...cell.matchAll(/`([^`]+)`/g)].map(([, code]) => code));
  assert.deepEqual(codesIn(declared), codesIn(literals));
  assert.deepEqual(listed(own).sort(), codesIn(literals));
  const ofCore = [...readFileSync(`${root}/crates/geometry/src/error.rs`, "utf8").matchAll(/Self::\w+ \{ \.\. \}(?: \| Self::\w+ \{ \.\. \})* => "([a-z0-9-]+)"/g)].map(([, code]) => code);
  assert.ok(ofCore.length > 20);
  assert.deepEqual(ofCore.filter((code) => !listed(core).includes(code)), []);
  assert.deepEqual(listed(core).filter((code) => !ofCore.includes(code)), []);
});
