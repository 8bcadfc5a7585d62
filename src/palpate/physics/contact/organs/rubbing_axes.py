"""The friction of two bodies that rotate: the axes of each body and of the patch, and how its bristles turn.

The patch has the axes of the world, to which the matrix R_b (3,3) turns those of body b. Between two steps the bristles
z turn with both bodies: kept as z_b = R_b' z, they are then along R_1 z_1 + R_2 z_2, which turns with the mean of both
spins. So a rotation of both bodies together turns the friction with them. Where the bodies roll, the mean normal of the
patch turns by another angle than they do on average, unless they have the same curvature: the bristles then follow it
by the smallest rotation from m, which is the last normal turned with the bodies, to the present one n,

    c z + v x z + v (v.z)/(1 + c),    v = m x n,    c = m.n

(parallel transport along the path of the contact): they remain along the surface. |z| does not change, so that neither
turn changes the energy of the bristles. Where one body turns by 180° against the other within a step, R_1 z_1 and
R_2 z_2 or the normals of the last step may cancel, and z has no direction: it is then zero, and `rubbing` counts its
energy as dissipated.

J. C. Simo, T. J. R. Hughes, Computational Inelasticity, 1998, ch. 8: objective rates.
"""

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Tensor, Vector3
from palpate.physics.bodies.floating.turning import cross, times, times_back

LEAST = 1e-12  # [1] of 1 + c, where the normal jumps to its opposite, and of a sum over its parts that do not cancel


@kernel
def add_turned(axes: Matrix, block: Matrix, share: float, out: Matrix):
    """Add `share` times R B R' to `out` (3,3)."""
    for j in range(3):
        x, y, z = axes[j, 0], axes[j, 1], axes[j, 2]
        column = (
            block[0, 0] * x + block[0, 1] * y + block[0, 2] * z,
            block[1, 0] * x + block[1, 1] * y + block[1, 2] * z,
            block[2, 0] * x + block[2, 1] * y + block[2, 2] * z,
        )
        turned = times(axes, column)
        for i in range(3):
            out[i, j] += share * turned[i]


@kernel
def keep_turned(axes: Tensor, x: Vector3, out: Matrix):
    """Fill `out` (2,3) with a vector of the patch in the axes of each body."""
    for body in range(2):
        y = times_back(axes[body], x)
        for i in range(3):
            out[body, i] = y[i]


@kernel
def _mean(axes: Tensor, kept: Matrix, size: float):
    """The vector (3) of this size along the sum of those that `keep_turned` kept; 0 if they cancel."""
    x, y = times(axes[0], kept[0]), times(axes[1], kept[1])
    s = (x[0] + y[0], x[1] + y[1], x[2] + y[2])
    whole = np.sqrt(dot(s, s))
    share = size / whole if whole > LEAST * size else 0.0
    return share * s[0], share * s[1], share * s[2]


@kernel
def turn_bristles(axes: Tensor, bristles: Matrix, facing: Matrix, n: Vector3, out: Array):
    """Fill `out` [m] (3) with z in this step.

    bristles [m], facing [1] (2,3)  z and the mean normal of the last step, `keep_turned`;  n [1] (3)  the present one
    """
    size = np.sqrt(0.5 * (dot(bristles[0], bristles[0]) + dot(bristles[1], bristles[1])))  # exchanged: the same bits
    out[:] = 0.0
    if size == 0.0:
        return
    z, m = _mean(axes, bristles, size), _mean(axes, facing, 1.0)
    v, c = cross(m, n), dot(m, n)
    about, share = cross(v, z), dot(v, z) / max(1.0 + c, LEAST)
    for i in range(3):
        out[i] = c * z[i] + about[i] + share * v[i]
