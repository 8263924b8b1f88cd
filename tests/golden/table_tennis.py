#!/usr/bin/env python3
"""Makes table_tennis.json: table tennis flights with drag, Magnus force and spinning bounces, seen by one camera.

Shares no code with the project.  Runge-Kutta 4 with steps of 20 us; contacts are located by bisection; an impact has
normal restitution and Coulomb friction at the contact point of a hollow sphere (inertia 2/3 m R^2).  Drag is
1/2 rho A C_d v^2, lift 1/2 rho A R C_l omega x v.  60 pictures a second.  Use: python table_tennis.py table_tennis.json
"""
import json
import sys

import numpy as np

R, M, RHO, CD, CL, MU, E, ALPHA = 0.02, 0.0027, 1.2, 0.45, 0.6, 0.25, 0.87, 2 / 3
G = np.array([0, 0, -9.81])
TABLE = np.array([1.37, 0.7625, 0.38])  # half sizes, centre at z = 0.38
AREA = np.pi * R * R
FPS, DT = 60, 2e-5


def acceleration(v, w):
    speed = np.linalg.norm(v)
    return G - 0.5 * RHO * AREA * CD / M * speed * v + 0.5 * RHO * AREA * R * CL / M * np.cross(w, v)


def advance(r, v, w, h):
    a1 = acceleration(v, w)
    v2 = v + h / 2 * a1
    a2 = acceleration(v2, w)
    v3 = v + h / 2 * a2
    a3 = acceleration(v3, w)
    v4 = v + h * a3
    a4 = acceleration(v4, w)
    return r + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def over_table(r):
    return abs(r[0]) < TABLE[0] and abs(r[1]) < TABLE[1]


def gap(r):
    return r[2] - (2 * TABLE[2] if over_table(r) else 0.0) - R


def bounce(v, w):
    n = np.array([0, 0, 1.0])
    vn = v @ n
    jn = -(1 + E) * vn
    slip = v - vn * n - R * np.cross(w, n)
    stick = -slip / (1 + 1 / ALPHA)
    jt = stick if np.linalg.norm(stick) <= MU * jn else -MU * jn * slip / np.linalg.norm(slip)
    return v + jn * n + jt, w - np.cross(n, jt) / (ALPHA * R)


def flight(rng):
    """States at the frame times, or None where the ball comes near the table's rim or does too little."""
    r = np.array([-1.5, rng.uniform(-.5, .5), rng.uniform(.95, 1.25)])
    v = np.array([rng.uniform(3.5, 6.0), rng.uniform(-.6, .6), rng.uniform(-1.5, 1.5)])
    w = np.array([rng.uniform(-40, 40), rng.uniform(-60, 120), rng.uniform(-40, 40)])
    spin, states, bounces = w.copy(), [], 0
    for k in range(75):
        states.append(np.concatenate([r, v, w]))
        left = 1 / FPS
        while left > 1e-12:
            h = min(DT, left)
            r2, v2 = advance(r, v, w, h)
            rim = abs(abs(r2[0]) - TABLE[0]) < .03 or abs(abs(r2[1]) - TABLE[1]) < .03
            if rim and r2[2] < 2 * TABLE[2] + .03:
                return (spin, states, bounces) if len(states) > 30 and bounces else None
            if gap(r2) < 0:
                low, high = 0.0, h
                for _ in range(60):
                    middle = (low + high) / 2
                    low, high = (middle, high) if gap(advance(r, v, w, middle)[0]) > 0 else (low, middle)
                r, v = advance(r, v, w, low)
                v, w = bounce(v, w)
                left -= low
                bounces += 1
            else:
                r, v = r2, v2
                left -= h
    return (spin, states, bounces) if bounces else None


def main():
    rng = np.random.default_rng(4)
    centre, target = np.array([0.3, -4.2, 2.4]), np.array([0.1, 0.0, 0.8])
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    extrinsic = np.eye(4)
    extrinsic[:3, :3], extrinsic[:3, 3] = rotation, -rotation @ centre
    intrinsic = np.array([[1000, 0, 639.5], [0, 1000, 359.5], [0, 0, 1.0]])
    clips = []
    while len(clips) < 12:
        found = flight(rng)
        if not found:
            continue
        spin, states, bounces = found
        world = np.array(states)[:, :3]
        camera = world @ rotation.T + extrinsic[:3, 3]
        image = (camera @ intrinsic.T)[:, :2] / camera[:, 2:]
        clips.append({
            "id": f"flight{len(clips):02d}", "fps": FPS, "bounces": bounces,
            "camera": {"width": 1280, "height": 720, "intrinsic": intrinsic.tolist(), "camera_from_world": extrinsic.tolist()},
            "scene": {"gravity": G.tolist(),
                      "ball": {"radius": R, "mass": M, "drag_coefficient": CD, "lift_coefficient": CL, "air_density": RHO,
                               "spin": spin.tolist(), "inertia_factor": ALPHA},
                      "contact": {"model": "bounce", "restitution": E, "friction": MU}, "floor": {"height": 0.0},
                      "boxes": [{"position": [0, 0, float(TABLE[2])], "half_size": TABLE.tolist(), "yaw": 0.0}]},
            "image": np.round(image, 6).tolist(), "visible": [True] * len(world), "world": np.round(world, 6).tolist()})
    with open(sys.argv[1], "w") as file:
        file.write("[\n" + ",\n".join(json.dumps(clip, separators=(",", ":")) for clip in clips) + "\n]\n")


main()
