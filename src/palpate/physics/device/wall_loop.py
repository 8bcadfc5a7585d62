"""Simulation of a device pressed against a sampled wall, with effects that linear theory neglects.

A mass with viscous drag and dry friction is pushed by a constant force against a wall at x = 0. The loop contains an
encoder, a delay, a velocity filter, lost samples and uneven steps, and optionally the controller.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.fields import blank_record
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Record, Vector
from palpate.physics.device.controller import GAINS, STATE, haptic, rings
from palpate.physics.device.stability import hold_step


class WallDevice(NamedTuple):
    """Parameters of a device.

    mass [kg] and drag [N s/m] > 0 of the moving grip; coulomb [N] dry friction; resolution [m] step of the position, 0:
    exact; limit [N] greatest force; slew [N/s] greatest change of it
    """

    mass: float = 0.1
    drag: float = 0.2
    coulomb: float = 0.0
    resolution: float = 60e-6
    limit: float = 9.0
    slew: float = 5000.0


@kernel
def advance(x: float, v: float, force: float, mass: float, drag: float, coulomb: float, dt: float):
    """Position [m] and velocity [m/s] after a step under a held force [N]; exact without dry friction. With it the step
    is divided into eight; in each the friction reduces the momentum, at most to zero."""
    parts = 8 if coulomb > 0.0 else 1
    h = dt / parts
    a, p, c, q = hold_step(mass, drag, h)
    for _ in range(parts):
        if v == 0.0 and abs(force) <= coulomb:
            continue
        x, v = x + a * v + c * force, p * v + q * force
        if coulomb > 0.0:
            v = math.copysign(max(abs(v) - coulomb / mass * h, 0.0), v)
    return x, v


@kernel
def _run(
    device: WallDevice,
    wall: Vector,
    gains: Record,
    state: Record,
    past: Record,
    controlled: bool,
    steps: Array,
    lost: Array,
    out: Matrix,
):
    mass, drag, coulomb, resolution = device.mass, device.drag, device.coulomb, device.resolution
    stiffness, damping, delay, order, push, begin, speed, twosided = wall
    x, v, force, energy, seen = begin, -speed, 0.0, 0.0, begin
    seen_at, last = np.full(int(order) + 1, begin), int(order)
    line = np.full(int(delay) + 1, begin)
    normal, zero = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for i in range(len(steps)):
        dt, before = steps[i], x
        # the device under the held force, and the energy that this force has generated
        x, v = advance(x, v, force - push, mass, drag, coulomb, dt)
        energy += force * (x - before)
        # delay line, then encoder; a lost sample repeats the last reading
        for k in range(len(line) - 1, 0, -1):
            line[k] = line[k - 1]
        line[0] = x
        if not lost[i]:
            seen = line[-1] if resolution == 0.0 else resolution * math.floor(line[-1] / resolution + 0.5)
        # velocity over the last `order` samples; spring and damper of the wall
        for k in range(last):
            seen_at[k] = seen_at[k + 1]
        seen_at[last] = seen
        rate = (seen - seen_at[0]) / (order * dt)
        force = 0.0
        if twosided != 0.0:
            force = -stiffness * seen - damping * rate
        elif seen < 0.0:
            force = max(-stiffness * seen - damping * rate, 0.0)
        if controlled:
            place, velocity = (0.0, 0.0, seen), (0.0, 0.0, rate)
            force = haptic(gains, state, past, force, normal, zero, max(-seen, 0.0), 0.0, place, velocity, dt)[2]
        elif twosided == 0.0:
            force = min(force, device.limit)
        out[i, 0], out[i, 1], out[i, 2] = x, force, energy
        if not abs(x) < 1e3:
            out[i:, 0] = math.inf
            return


def run(
    device: WallDevice,
    stiffness: float,
    damping: float,
    *,
    controlled: bool,
    steps: np.ndarray,
    delay: int = 0,
    order: int = 1,
    lost: np.ndarray | None = None,
    push: float = 0.5,
    free: bool = False,
    begin: float = 1e-3,
) -> np.ndarray:
    """Position [m], force [N] and energy delivered to the hand [J], (k,3), over steps [s] (k).

    stiffness [N/m], damping [N s/m] of the wall on the mean of `order` differences; delay [1] samples; lost (k) bool,
    samples that repeat the previous one; push [N] of the hand; free: no hand and a two-sided wall; begin [m] start
    """
    gains = blank_record(
        GAINS, hysteresis=device.resolution, mass=device.mass, drag=device.drag, limit=device.limit, slew=device.slew,
        resolution=device.resolution, observes=True, passive=True,
    )  # fmt: skip
    speed = 0.0 if free else 0.05
    wall = (stiffness, damping, float(delay), float(order), 0.0 if free else push, begin, speed, float(free))
    out = np.zeros((len(steps), 3))
    missing = np.zeros(len(steps), dtype=np.bool_) if lost is None else lost
    _run(device, wall, gains, blank_record(STATE), rings(delay), controlled, steps, missing, out)
    return out


def felt_stiffness(paths: tuple[np.ndarray, np.ndarray]) -> float:
    """Stiffness [N/m] that a hand feels, from two runs with different pushes (k,3): dF/dx between their means over the
    last quarter. `inf` if the second push does not move the device further."""
    (x, force), (further, more) = (part[-len(part) // 4 :, :2].mean(axis=0) for part in paths)
    return float((more - force) / (x - further)) if further < x else math.inf


def settles(path: np.ndarray, resolution: float) -> bool:
    """Whether positions [m] (k) come to rest: the amplitude in the last quarter is at most 90 % of that in the quarter
    before, or at most two steps of the position plus 5 um."""
    if not np.isfinite(path).all():
        return False
    *_, before, last = (float(np.ptp(part)) for part in np.array_split(path, 4))
    return last <= max(0.9 * before, 2.0 * resolution + 5e-6)
