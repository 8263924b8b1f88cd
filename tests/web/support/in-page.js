/** What the tests run inside a page that offers the package as `window.gravisight`. They see nothing else of this file. */

export async function throwOne() {
  const { Toolbox, Track } = window.gravisight;
  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const times = Array.from({ length: 90 }, (_, index) => index / 60);
  const path = await simulator.path({ position: [0.6, 0.5, 1.6], velocity: [-1, 0, -1.4] }, times);
  const images = await toolbox.project(simulator.camera, path);
  const track = await Track.create({ camera: simulator.camera, scene: simulator.scene, toolbox });
  // Every fifth frame is not seen, and one sighting is not to be believed.
  images.forEach((image, index) => track.add({ timestampMs: 1000 + times[index] * 1000, image: index % 5 === 4 ? null : image, confidence: 0.99 }));
  track.add({ timestampMs: 1000 + 1500, image: [3, 3], confidence: 0.01 });
  let order = "taken";
  try {
    track.add({ timestampMs: 2, image: null });
  } catch (thrown) {
    order = thrown.code;
  }
  const { frames: fitted, impacts, explained } = await track.fit();
  const off = fitted.slice(0, 90).map(({ world }, index) => Math.hypot(...world.map((value, axis) => value - path[index][axis])));
  toolbox.dispose();
  return {
    worst: Math.max(...off),
    sigma: Math.max(...fitted.slice(0, 90).map(({ sigma }) => sigma)),
    speed: Math.hypot(fitted[0].velocity[0], fitted[0].velocity[1]),
    bounces: impacts.length,
    explained,
    order,
  };
}

export async function fineTune({ model, steps, ...options }) {
  const { FineTuner, Localiser, Toolbox } = window.gravisight;
  const toolbox = await Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 2 });
  const clip = async (number) => {
    const { fps, frames } = await simulator.clip(7, number);
    const drawn = [];
    for (const { t, image, world } of frames) {
      const { data, width, height } = await simulator.picture(world);
      drawn.push({ picture: new ImageData(data, width, height), t, image, world });
    }
    return { id: `clip ${number}`, fps, camera: simulator.camera, scene: simulator.scene, frames: drawn };
  };
  const tuner = await FineTuner.create({ model, steps, batch: 8, ...options });
  for (const number of [0, 1, 2, 3]) {
    const given = await clip(number);
    // The 3D truth is for scoring only.
    given.frames = given.frames.map(({ world: _, ...frame }) => frame);
    await tuner.addClip(given);
  }
  const held = await clip(50);
  for (const other of [held, await clip(51), await clip(52)]) await tuner.addClip(other, { heldOut: true });
  const before = await tuner.evaluate();
  const start = performance.now();
  let made = 0;
  const controller = new AbortController();
  const aborting = await tuner.step(steps, { signal: controller.signal, onStep: () => ++made === 3 && controller.abort() }).catch((thrown) => thrown.name);
  const goesOn = (await tuner.step(1)).step;
  await tuner.step(steps);
  const seconds = (performance.now() - start) / 1000;
  const after = await tuner.evaluate();
  const { card, weights } = await tuner.export();
  tuner.dispose();
  toolbox.dispose();
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 224;
  canvas.getContext("2d").putImageData(held.frames[10].picture, 0, 0);
  const png = canvas.toDataURL("image/png").split(",")[1];
  const localiser = await Localiser.create({ model: { card, weights }, camera: simulator.camera });
  const found = (await localiser.localise(Uint8Array.from(atob(png), (c) => c.charCodeAt(0)))).world;
  localiser.dispose();
  let binary = "";
  for (let index = 0; index < weights.length; index += 8192) binary += String.fromCharCode(...weights.subarray(index, index + 8192));
  return { before, after, steps, seconds, aborted: [aborting, goesOn >= 4], card, weights: btoa(binary), found, camera: simulator.camera, png };
}

/** On the page's own thread, where its memory can be seen. */
export async function prepareSoak({ model, camera }) {
  const instantiate = WebAssembly.instantiate;
  WebAssembly.instantiate = async (...given) => {
    const made = await instantiate(...given);
    window.memory = (made.instance ?? made).exports.memory;
    return made;
  };
  window.localiser = await window.gravisight.Localiser.create({ model, camera, worker: false });
  WebAssembly.instantiate = instantiate;
}

export async function soak({ from, to }) {
  const canvas = new OffscreenCanvas(224, 224);
  const context = canvas.getContext("2d");
  for (let frame = from; frame <= to; frame++) {
    context.fillStyle = `hsl(${frame % 360} 50% 50%)`;
    context.fillRect(0, 0, 224, 224);
    const picture = new VideoFrame(canvas, { timestamp: frame * 33000 });
    const { timestampMs } = await window.localiser.localiseVideoFrame(picture, frame * 33);
    picture.close();
    if (timestampMs !== frame * 33) throw new Error(`${timestampMs} ms for frame ${frame}`);
  }
  return window.memory.buffer.byteLength;
}

export async function abortARun({ model, camera, base64 }) {
  const localiser = await window.gravisight.Localiser.create({ model });
  const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const mine = new Error("mine");
  const controller = new AbortController();
  const { signal } = controller;
  const run = () => localiser.localise(bytes, { camera, signal }).then(() => false, (thrown) => thrown === mine);
  const running = [run(), run()];
  await new Promise((resolve) => setTimeout(resolve, 5));
  controller.abort(mine);
  const aborted = await Promise.all([...running, run()]);
  const next = await localiser.localise(bytes, { camera });
  localiser.dispose();
  return { aborted, served: next.world.length };
}

/** Runs in a Worker: a message "lose" takes its WebGPU device away. */
export function losesDevice() {
  const request = GPUAdapter.prototype.requestDevice;
  let device;
  GPUAdapter.prototype.requestDevice = async function (...options) {
    return (device = await request.apply(this, options));
  };
  addEventListener("message", ({ data }) => data === "lose" && device.destroy());
}

/** A thrown ball, drawn; with its rate, its camera, its place and its true path. Runs in a page that offers the package. */
export async function drawThrow() {
  const toolbox = await window.gravisight.Toolbox.create();
  const simulator = await toolbox.simulator({ environment: 1, camera: 1 });
  const { camera, scene } = simulator;
  const { fps, frames } = await simulator.clip(2025, 3);
  const path = frames.map(({ world }) => world).slice(0, 45);
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: camera.width, height: camera.height });
  const pictures = [];
  for (const centre of path) {
    const { data, width, height } = await simulator.picture(centre);
    canvas.getContext("2d").putImageData(new ImageData(data, width, height), 0, 0);
    pictures.push(canvas.toDataURL("image/png").split(",")[1]);
  }
  toolbox.dispose();
  return { pictures, fps, camera, scene, path };
}

/** What the page keeps under a key; null where there is nothing. */
export function storedIn(key) {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("keyval-store");
    opening.onerror = () => reject(opening.error);
    opening.onsuccess = () => {
      const reading = opening.result.transaction("keyval").objectStore("keyval").get(key);
      reading.onsuccess = () => {
        opening.result.close();
        // Files do not leave the page.
        resolve(reading.result ? { ...reading.result, ...(reading.result.pictures && { pictures: reading.result.pictures.map(() => 0) }) } : null);
      };
    };
  });
}

/** Changes fields of what the page keeps under a key; those that are null are removed. */
export function changeStored([key, fields]) {
  return new Promise((resolve, reject) => {
    const opening = indexedDB.open("keyval-store");
    opening.onerror = () => reject(opening.error);
    opening.onsuccess = () => {
      const store = opening.result.transaction("keyval", "readwrite").objectStore("keyval");
      const reading = store.get(key);
      reading.onsuccess = () => {
        const changed = Object.fromEntries(Object.entries({ ...reading.result, ...fields }).filter(([, value]) => value !== null));
        store.put(changed, key).onsuccess = () => {
          opening.result.close();
          resolve();
        };
      };
    };
  });
}
