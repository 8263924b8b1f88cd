#!/usr/bin/env python3
"""Makes mujoco_paths.json: where MuJoCo's ball is in the paper's three environments, for tests/mujoco.rs.

Use: MUJOCO_GL=osmesa python mujoco_paths.py PATH/mujoco_clips.py mujoco_paths.json
Simulator, scenes and start distribution are those of mujoco_clips.py (which shares no code with the project).  Five
starts an environment that stay in camera 1's picture; starts rounded to 1e-6 (m, m/s) before they are simulated, every
third frame's position to 1e-9 m.
"""
import importlib.util
import json
import sys

import numpy as np

STARTS = 5
EVERY = 3


def main():
    tool_path, out = sys.argv[1:]
    spec = importlib.util.spec_from_file_location("mujoco_clips", tool_path)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    m_int, m_ext, _ = tool.camera(1)
    tracks = []
    for env in tool.BOXES:
        scene, rng = tool.Scene(env, samples=0, shadow=0), np.random.default_rng([20231130, env])
        while len(tracks) < STARTS * env:
            r0, v0 = (np.round(part, 6) for part in tool.start_state(rng))
            positions = scene.simulate(r0, v0)
            image, _ = tool.project(m_int, m_ext, positions)
            if image.min() >= 0 and image.max() <= tool.SIZE - 1:
                tracks.append({"environment": env, "position": r0.tolist(), "velocity": v0.tolist(),
                               "world": np.round(positions[::EVERY], 9).tolist()})
    about = f"Made by tests/golden/mujoco_paths.py; MuJoCo {tool.mujoco.__version__}"
    lines = ",\n".join(json.dumps(track, separators=(",", ":")) for track in tracks)
    with open(out, "w") as file:
        file.write(f'{{"about":"{about}","seconds":{EVERY / tool.FPS},"tracks":[\n{lines}\n]}}\n')


main()
