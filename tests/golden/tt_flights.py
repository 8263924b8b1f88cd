#!/usr/bin/env python3
"""Makes tt_flights.json: single strokes over a table tennis table, seen by three cameras, with noisy labels and the truth.

Shares no code with the project, and not its laws either: lift that saturates with the spin, a drag that differs from flight to
flight, a restitution that falls with the speed, a friction that differs from bounce to bounce. Who fits these flights has
textbook values for all of them, as with real ones.

- Drag 1/2 rho A C_d v^2; lift 1/2 rho A C_l v^2 with C_l = 1 / (2.022 + 0.981 v / (R w)) (A. Stepanek, "The aerodynamics of
  tennis balls: the topspin lob", Am. J. Phys. 56 (1988) 138).
- The table: rigid, Coulomb friction at the contact of a hollow sphere (inertia 2/3 m R^2), which grips where friction suffices.
- Velocity Verlet with steps of 50 us; the bounce is where a step's straight line crosses the table.
- 50 pictures a second, 1 px of normal noise a coordinate, one label in twenty missing.

World: origin in the middle of the table's surface, y along the table, z up; metres. Needs numpy: python tt_flights.py tt_flights.json
"""
import json
import sys

import numpy as np

RADIUS, MASS, DENSITY = 0.02, 0.0027, 1.2
AREA, GRAVITY = np.pi * 0.02**2, np.array([0.0, 0.0, -9.81])
HALF_WIDTH, HALF_LENGTH, NET = 0.7625, 1.37, 0.1525
STEP, FPS, NOISE, MISSING, FLIGHTS = 5e-5, 50, 1.0, 0.05, 12
WIDTH, HEIGHT, FOCAL = 1920, 1080, 1500.0
EYES = {"side": [5.5, 0.0, 1.2], "oblique": [4.5, -4.5, 2.0], "behind": [0.4, -6.5, 1.8]}


def acceleration(velocity, spin, drag):
    speed = np.linalg.norm(velocity)
    pressure = 0.5 * DENSITY * AREA * speed**2 / MASS
    force = GRAVITY - pressure * drag * velocity / speed
    across = np.cross(spin, velocity)
    size = np.linalg.norm(across)
    if size > 0:
        turning = size / speed  # the part of the spin across the way
        force = force + pressure / (2.022 + 0.981 * speed / (RADIUS * turning)) * across / size
    return force


def rebound(velocity, spin, restitution, friction):
    normal = np.array([0.0, 0.0, 1.0])
    closing = -velocity[2]
    arm = -RADIUS * normal
    slip = velocity + np.cross(spin, arm)
    slip[2] = 0.0
    sliding = np.linalg.norm(slip)
    # To stop the slip of a sphere of inertia 2/3 m R^2 takes 1 / (1 + 3/2) of it.
    change = min(friction * (1 + restitution) * closing, sliding / 2.5)
    push = -slip / sliding * change if sliding > 0 else np.zeros(3)
    spin = spin + 1.5 * np.cross(arm, push) / RADIUS**2
    return velocity + push + (1 + restitution) * closing * normal, spin


def stroke(random):
    """Positions at each step and when the ball bounced, or None for what is no stroke."""
    side = random.choice([-1.0, 1.0])
    position = np.array([random.uniform(-0.6, 0.6), -side * random.uniform(1.0, 1.9), random.uniform(0.1, 0.5)])
    velocity = np.array([random.normal(0, 0.8), side * random.uniform(3.5, 9.0), random.uniform(-0.5, 3.0)])
    spin = np.array([-side * random.normal(60, 150), random.normal(0, 60), random.normal(0, 60)])
    drag, friction = random.normal(0.45, 0.035), random.normal(0.25, 0.04)
    positions, bounced, after = [position], None, random.uniform(0.14, 0.3)
    force = acceleration(velocity, spin, drag)
    while bounced is None or len(positions) * STEP < bounced + after:
        following = position + STEP * velocity + STEP**2 / 2 * force
        new_force = acceleration(velocity + STEP * force, spin, drag)
        velocity = velocity + STEP / 2 * (force + new_force)
        if position[1] * following[1] < 0 and following[2] < NET + RADIUS:
            return None
        if following[2] < RADIUS:
            over = abs(following[0]) < HALF_WIDTH and 0.05 < side * following[1] < HALF_LENGTH
            if bounced is not None or not over:
                return None
            bounced = len(positions) * STEP
            restitution = 0.94 - 0.012 * -velocity[2] + random.normal(0, 0.015)
            velocity, spin = rebound(velocity, spin, restitution, friction)
            following[2] = RADIUS
        position, force = following, acceleration(velocity, spin, drag)
        positions.append(position)
        if len(positions) * STEP > 1.5 or abs(position[1]) > 3.5:
            return None
    return (np.array(positions), bounced) if bounced > 0.2 else None


def camera(eye):
    eye = np.array(eye)
    forward = np.array([0.0, 0.0, 0.1]) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ eye
    intrinsic = [[FOCAL, 0.0, (WIDTH - 1) / 2], [0.0, FOCAL, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]]
    return {"width": WIDTH, "height": HEIGHT, "intrinsic": intrinsic, "camera_from_world": pose.tolist()}


def image(seen_by, points):
    pose, intrinsic = np.array(seen_by["camera_from_world"]), np.array(seen_by["intrinsic"])
    homogeneous = (points @ pose[:3, :3].T + pose[:3, 3]) @ intrinsic.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def main():
    random = np.random.default_rng(11)
    cameras = {name: camera(eye) for name, eye in EYES.items()}
    flights = []
    while len(flights) < FLIGHTS:
        found = stroke(random)
        if found is None:
            continue
        positions, bounced = found
        times = np.arange(random.uniform(0, 1 / FPS), (len(positions) - 1) * STEP, 1 / FPS)
        world = positions[np.round(times / STEP).astype(int)]
        labels = {}
        for name, seen_by in cameras.items():
            noisy = image(seen_by, world) + random.normal(0, NOISE, (len(world), 2))
            gone = random.random(len(world)) < MISSING
            labels[name] = [None if hidden else np.round(at, 2).tolist() for at, hidden in zip(noisy, gone)]
        flights.append({"times": np.round(times, 5).tolist(), "bounce": round(bounced, 5),
                        "world": np.round(world, 5).tolist(), "labels": labels})
    with open(sys.argv[1], "w") as file:
        dump = lambda value: json.dumps(value, separators=(",", ":"))
        file.write('{"generator":"tests/golden/tt_flights.py",\n"cameras":' + dump(cameras) + ',\n"flights":[\n')
        file.write(",\n".join(map(dump, flights)) + "\n]}\n")


main()
