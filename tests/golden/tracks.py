#!/usr/bin/env python3
"""Makes tracks.json: 2D labels, positions and velocities of MuJoCo's ball in the paper's scenes, without pictures.

Use: MUJOCO_GL=osmesa python tracks.py PATH/mujoco_clips.py tracks.json [PATH/samples/clips.jsonl]
The simulator, scenes, cameras and start distribution are those of mujoco_clips.py (which shares no code with the
project); this file adds the velocities, which the clips do not hold.  First the sample clips, simulated again from
their first two positions, then 30 of the test split (without the samples: 30 of the training split, to tune on).
Rounded to 1e-6 (px, m, m/s).
"""
import importlib.util
import json
import math
import sys

import numpy as np

# environment, camera, clips: 30 in all
OTHERS = [(1, 1, 10), (1, 2, 2), (1, 3, 2), (1, 4, 2), (1, 5, 2), (1, 6, 2), (2, 1, 2), (2, 4, 1), (2, 6, 1),
          (3, 2, 2), (3, 3, 1), (3, 5, 1), (1, 8, 1), (1, 9, 1)]


def main():
    tool_path, out = sys.argv[1:3]
    samples = [json.loads(line) for line in open(sys.argv[3])] if len(sys.argv) > 3 else []
    split = "test" if samples else "train"
    spec = importlib.util.spec_from_file_location("mujoco_clips", tool_path)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    scenes = {env: tool.Scene(env, samples=0, shadow=0) for env in tool.BOXES}

    def simulate(scene, r0, v0):
        m, d = scene.model, scene.data
        tool.mujoco.mj_resetData(m, d)
        d.qpos[:3], d.qvel[:3] = r0, v0
        states = []
        for _ in range(tool.FRAMES):
            states.append(np.concatenate([d.qpos[:3], d.qvel[:3]]))
            for _ in range(tool.SUBSTEPS):
                tool.mujoco.mj_step(m, d)
        return np.array(states)

    def start_of(sample):
        r, after = (np.array(sample["frames"][k]["world"]) for k in (0, 1))
        n, dt = tool.SUBSTEPS, 1 / (tool.FPS * tool.SUBSTEPS)  # semi-implicit Euler, no contact in the first frame
        return r, (after - r) / (n * dt) + np.array([0, 0, tool.GRAVITY * dt * (n + 1) / 2])

    def clip(split, env, cam, index, sample=None):
        m_int, m_ext, centre = tool.camera(cam)
        rng = np.random.default_rng([20231130, tool.SPLITS[split], env, cam, index])
        while True:
            states = simulate(scenes[env], *(start_of(sample) if sample else tool.start_state(rng)))
            image, in_camera = tool.project(m_int, m_ext, states[:, :3])
            if image.min() >= 0 and image.max() <= tool.SIZE - 1 and in_camera[:, 2].min() > 0:
                break
        if sample:
            assert np.abs(states[:, :3] - [frame["world"] for frame in sample["frames"]]).max() < 1e-6, sample["id"]
        visible = [bool(scenes[env].visible(r, m_ext, centre) > 0) for r in states[:, :3]]
        boxes = [{"position": [*xy, 0.0], "half_size": half, "yaw": math.radians(yaw)} for xy, half, yaw, _ in tool.BOXES[env]]
        return {
            "id": f"{split}/env{env}/cam{cam}/{index:04d}", "fps": tool.FPS,
            "camera": {"width": tool.SIZE, "height": tool.SIZE, "intrinsic": m_int.tolist(), "camera_from_world": m_ext.tolist()},
            "scene": {"gravity": [0, 0, -tool.GRAVITY], "ball": {"radius": tool.RADIUS, "mass": tool.MASS},
                      "contact": {"model": "spring", "stiffness": tool.STIFFNESS}, "floor": {"height": 0.0}, "boxes": boxes},
            "image": np.round(image, 6).tolist(), "visible": visible,
            "world": np.round(states[:, :3], 6).tolist(), "velocity": np.round(states[:, 3:], 6).tolist()}

    first = 1000 if split == "test" else 0
    wanted = [(split, env, cam, first + i, None) for env, cam, count in OTHERS for i in range(count)]
    for sample in reversed(samples):
        parts = sample["id"].split("/")
        wanted.insert(0, (parts[0], int(parts[1][3:]), int(parts[2][3:]), int(parts[3]), sample))
    with open(out, "w") as file:
        file.write("[\n" + ",\n".join(json.dumps(clip(*w), separators=(",", ":")) for w in wanted) + "\n]\n")


main()
