"""Friction along and across the direction in which the finger slides.

With the slip velocity v [m/s] in the plane of the surface, its outward unit normal n and the friction force f [N] of
the finger on the surface,

    t = v/|v|,   b = n × t,   f_f = f·t,   f_b = f·b,   f_f² + f_b² = |f|²

f_b is positive to the left of the motion, seen from outside. Coulomb's law has f_b = 0. In a law with bristles f_b is
the memory of an earlier direction: after a turn, at a constant speed and load, it decays with the distance g/σ0.

The frame t, b, n is that of the measured forces f_f, f_b, f_n of the kidney study (a soft fingertip on a kidney,
Falcon, its figure 10), where f_b was small, and was explained by the device's resolution, by dynamics that were not
compensated, and by noise.
"""

import math

import numpy as np

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Array, Vector3
from palpate.physics.friction.bristle import NOTHING, carry

SLOW = 5e-3  # [m/s] default speed below which the direction of the last motion is kept: encoder counts decide it


@ieee_kernel
def split(way: Vector3, last: Vector3, force: Vector3, normal: Vector3, slip: Vector3, slow: float):
    """(f_f, f_b, speed, t) of one instant.

    way    [1]   (3)  t of the last instant, tangent to the surface of the normal `last` [1] (3); 0: not known
    force  [N]   (3)  friction of the finger on the surface;  normal [1] (3), outward;  slip [m/s] (3)
    slow   [m/s] ()   at and below this speed t is that of the last instant, turned with the normal

    Before the finger has slid faster, t is not known: it is that of the force, f_f = |f|, and 0 is returned for it.
    """
    way, v = carry(way, last, normal, slip)
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if speed > slow:
        way = (v[0] / speed, v[1] / speed, v[2] / speed)
    if way[0] == 0.0 and way[1] == 0.0 and way[2] == 0.0:
        return math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]), 0.0, speed, way
    x = normal[1] * way[2] - normal[2] * way[1]
    y = normal[2] * way[0] - normal[0] * way[2]
    z = normal[0] * way[1] - normal[1] * way[0]
    along = force[0] * way[0] + force[1] * way[1] + force[2] * way[2]
    return along, force[0] * x + force[1] * y + force[2] * z, speed, way


@kernel
def _fill(force: Array, normal: Array, slip: Array, load: Array, slow: float, out: Array):
    way, last = NOTHING, (0.0, 0.0, 1.0)
    for i in range(len(load)):
        if not load[i] > 0.0:
            way = NOTHING
            continue
        here = vector(normal[i])
        out[i, 0], out[i, 1], _, way = split(way, last, vector(force[i]), here, vector(slip[i]), slow)
        last = here


def split_rows(
    force: np.ndarray, normal: np.ndarray, slip: np.ndarray, load: np.ndarray, slow: float = SLOW
) -> tuple[np.ndarray, np.ndarray]:
    """(f_f, f_b) [N] (n) of the consecutive instants of a touch, as `split`; 0 without a normal force `load` [N] (n).

    force [N] (n,3), normal [1] (n,3), slip [m/s] (n,3)
    """
    out = np.zeros((len(load), 2))
    given = (np.ascontiguousarray(values, dtype=float) for values in (force, normal, slip, load))
    _fill(*given, float(slow), out)
    return out[:, 0], out[:, 1]
