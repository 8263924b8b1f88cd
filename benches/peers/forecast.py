"""The paper's equations of motion in torchdiffeq and diffrax, for benches/forecast.rs.

Reads one JSON object on standard input: scene (penalty model), starts [n][6], times, rtol, atol, max_step, rounds.
Prints one JSON object: seconds for all starts, the median over rounds, by peer and job; and the positions at the end.
With "check": true it prints the accelerations at the starts instead, without the peers.
f64; threads 1, or 0 for as many as the peer takes.  "gradient" is the forecast of all starts and one backward pass;
"jacobian" all 6x6 Jacobians (torchdiffeq's take a minute: one round, with one thread only).
"""
import json
import math
import os
import statistics
import sys
import time

job = json.load(sys.stdin)
if job["threads"] == 1:
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["OMP_NUM_THREADS"] = "1"

scene, times = job["scene"], job["times"]
c, beta, beta_box = (scene["contact"][k] for k in ("c", "beta", "beta_box"))
g = -scene["gravity"][2]


def boxes(array):
    """Centre, half size and the cosine and sine of the rotation about z of each box."""
    out = []
    for b in scene.get("boxes", []):
        w, x, y, z = b.get("rotation") or (math.cos(b.get("yaw", 0) / 2), 0, 0, math.sin(b.get("yaw", 0) / 2))
        assert abs(x) + abs(y) < 1e-12, "the paper's boxes stand upright"
        out.append((array(b["position"]), array(b["half_size"]), (w * w - z * z, 2 * w * z)))
    return out


def acceleration(r, obstacles, sigmoid):
    """m/s² at a position of three components."""
    az = -g * sigmoid(beta * r[2]) + c * sigmoid(-beta * r[2])
    ax = ay = 0 * az
    for p, half, (cos, sin) in obstacles:
        d = [r[i] - p[i] for i in range(3)]
        q = [cos * d[0] + sin * d[1], cos * d[1] - sin * d[0], d[2]]
        up = [sigmoid(beta_box * (q[i] + half[i])) for i in range(3)]
        down = [sigmoid(beta_box * (q[i] - half[i])) for i in range(3)]
        s = [u - w for u, w in zip(up, down)]
        ds = [u * (1 - u) - w * (1 - w) for u, w in zip(up, down)]
        a = [-c * ds[0] * s[1] * s[2], -c * s[0] * ds[1] * s[2], -c * s[0] * s[1] * ds[2]]
        ax, ay, az = ax + cos * a[0] - sin * a[1], ay + sin * a[0] + cos * a[1], az + a[2]
    return ax, ay, az


if job.get("check"):
    logistic = lambda x: 1 / (1 + math.exp(-x)) if x > 0 else math.exp(x) / (1 + math.exp(x))
    print(json.dumps([acceleration(start, boxes(list), logistic) for start in job["starts"]]))
    sys.exit()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import diffrax  # noqa: E402
import torch  # noqa: E402
from torchdiffeq import odeint  # noqa: E402

jax.config.update("jax_enable_x64", True)
torch.set_default_dtype(torch.float64)
if job["threads"] == 1:
    torch.set_num_threads(1)

def field(concatenate, sigmoid, stack, obstacles):
    """d(state)/dt of states [..., 6]."""

    def derivative(y):
        r, v = y[..., :3], y[..., 3:]
        ax, ay, az = acceleration([r[..., i] for i in range(3)], obstacles, sigmoid)
        return concatenate([v, stack([ax, ay, az])], -1)

    return derivative


def median_seconds(work, rounds):
    work()
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def with_torch():
    f = field(torch.cat, torch.sigmoid, lambda parts: torch.stack(parts, -1), boxes(torch.tensor))
    t = torch.tensor([0.0, *times])
    starts = torch.tensor(job["starts"])

    def solve(y):
        return odeint(lambda _, y: f(y), y, t, method="dopri5", rtol=job["rtol"], atol=job["atol"],
                      options={"max_step": job["max_step"]})[1:]

    def gradient():
        y = starts.clone().requires_grad_(True)
        solve(y).sum().backward()
        return y.grad

    def jacobian():
        y = starts.clone().requires_grad_(True)
        out = solve(y)
        for k in range(out.shape[0]):
            for i in range(6):
                torch.autograd.grad(out[k, :, i].sum(), y, retain_graph=True)

    rounds = max(3, job["rounds"] // 10)
    begin = time.perf_counter()
    if job["threads"] == 1:
        jacobian()
    whole = time.perf_counter() - begin if job["threads"] == 1 else None
    return {"forward": median_seconds(lambda: solve(starts), rounds), "gradient": median_seconds(gradient, rounds),
            "jacobian": whole, "end": solve(starts)[-1].tolist()}


def with_diffrax():
    f = field(jnp.concatenate, jax.nn.sigmoid, lambda parts: jnp.stack(parts, -1), boxes(jnp.array))
    term = diffrax.ODETerm(lambda t, y, args: f(y))
    controller = diffrax.PIDController(rtol=job["rtol"], atol=job["atol"], dtmax=job["max_step"])
    starts = jnp.array(job["starts"])

    def solve(y, adjoint):
        return diffrax.diffeqsolve(term, diffrax.Dopri5(), 0.0, times[-1], job["max_step"], y, adjoint=adjoint,
                                   saveat=diffrax.SaveAt(ts=jnp.array(times)), stepsize_controller=controller, max_steps=4096).ys

    reverse, ahead = diffrax.RecursiveCheckpointAdjoint(), diffrax.ForwardMode()
    forward = jax.jit(jax.vmap(lambda y: solve(y, reverse)))
    gradient = jax.jit(jax.grad(lambda y: jax.vmap(lambda y: solve(y, reverse))(y).sum()))
    jacobian = jax.jit(jax.vmap(jax.jacfwd(lambda y: solve(y, ahead))))
    wait = lambda work: lambda: jax.block_until_ready(work(starts))
    rounds = job["rounds"]
    return {"forward": median_seconds(wait(forward), rounds), "gradient": median_seconds(wait(gradient), rounds),
            "jacobian": median_seconds(wait(jacobian), rounds), "end": forward(starts)[:, -1].tolist()}


print(json.dumps({"torchdiffeq": with_torch(), "diffrax": with_diffrax()}))
