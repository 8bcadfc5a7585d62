"""What large displacement does to the force that indents a linear organ under a patch.

At a place of the surface a load f spread over a patch of radius R indents the linear organ of modulus E by c f. The
nonlinear one takes, for an indentation s,

    f(s) = s/c (1 + rho(s/R))

rho [1], the nonlinear indentation table, is taken from the full model at some places and between them by interpolation
over the surface; being free of units it serves any modulus and patches of other radii (exact on a half-space, where no
other length is). It is kept by the indentation, not by the force, as the force has an end (a limit load) where the
indentation goes on.

An organ under loads h of any kind is seen by the patch g through y = gCh/gCg: the force on the patch alone that would
indent it as much. With the linear organ's complementary energy hCh/2E the nonlinear one has

    V*(h) = hCh/2E + psi(y),    dpsi/df = s(f) - c f

whose displacement dV*/dh = (C/E)(h + k g), k = (s(y) - c y)/c, is that of the linear organ under k more load on the
patch. V* is convex as long as f(s) rises, whatever C: so the body is passive. `rise` holds it to that.
"""

from __future__ import annotations

import numpy as np

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel

SPACING = 0.1
"""[1] Of the values of s/R in the table, from SPACING on; beyond the last the body
stiffens, see `STIFFER`."""
STIFFER, FLAT = 2.0, 0.2
"""[1] By the square of s/R beyond the last value x grows `STIFFER` times what its last slope is above `FLAT`: nothing
is known there, so the body lets the finger through less and less. One that ends on a plateau stays on it."""
SOFTEST = 0.05
"""Least tangent stiffness, over that at rest, that the table may lead to."""


def hat_moments(mesh: Mesh) -> np.ndarray:
    """Mean square distance [m²] (V,) from each vertex of a force spread over its triangles, highest at the vertex."""
    corner = mesh.vertices[mesh.triangles]
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)
    moment, weight = np.zeros(len(mesh.vertices)), np.zeros(len(mesh.vertices))
    for k in range(3):
        first, second = (corner[:, (k + i) % 3] - corner[:, k] for i in (1, 2))
        square = np.sum(first * first + second * second + first * second, axis=1)
        np.add.at(moment, mesh.triangles[:, k], area * square / 30.0)
        np.add.at(weight, mesh.triangles[:, k], area / 3.0)
    return moment / weight


@kernel
def patch_radius(points, moments, nodes, count, share):
    """Radius R [m] of a patch: twice the root mean square distance of its force from its centre, which is the radius
    of a uniform or biweight patch to within 1.42 and 1.

    nodes (>= count) vertices of the patch, share (V,3) whose first column holds their parts, taken without sign
    """
    total = x0 = x1 = x2 = 0.0
    for k in range(count):
        v = nodes[k]
        w = abs(share[v, 0])
        total += w
        x0 += w * points[v, 0]
        x1 += w * points[v, 1]
        x2 += w * points[v, 2]
    x0, x1, x2 = x0 / total, x1 / total, x2 / total
    square = 0.0
    for k in range(count):
        v = nodes[k]
        d0, d1, d2 = points[v, 0] - x0, points[v, 1] - x1, points[v, 2] - x2
        square += abs(share[v, 0]) * (d0 * d0 + d1 * d1 + d2 * d2 + moments[v])
    return 2.0 * np.sqrt(square / total)


@kernel
def rise(table, nodes, count, share, knots, slopes):
    """Make x against s/R at a patch, x = c f/R the linear organ's s/R: `knots` and `slopes` (L+1,) at s/R = 0, SPACING,
    2 SPACING ...

    table (V,L) rho, averaged over the patch. Where they would let the force fall, it rises with `SOFTEST` of the
    linear slope instead, until they are above that. Slopes are those of a parabola through the neighbours, held below
    twice either chord: so the cubic between rises too. F. N. Fritsch, R. E. Carlson, SIAM J. Numer. Anal. 17 (1980)
    238-246.
    """
    levels = table.shape[1]
    knots[0] = 0.0
    for k in range(levels):
        dent = 0.0
        for m in range(count):
            v = nodes[m]
            dent += share[v, 0] * table[v, k]
        knots[k + 1] = max((k + 1) * SPACING * (1.0 + dent), knots[k] + SOFTEST * SPACING)
    for k in range(levels + 1):
        left = (knots[k] - knots[max(k - 1, 0)]) / SPACING
        right = (knots[min(k + 1, levels)] - knots[k]) / SPACING
        if k == 0:
            slopes[k] = min(1.0, 2.0 * right) if levels > 0 else 1.0
        elif k == levels:
            further = (knots[k - 1] - knots[k - 2]) / SPACING if k > 1 else 1.0
            slopes[k] = min(max(1.5 * left - 0.5 * further, SOFTEST), 2.0 * left)
        else:
            slopes[k] = min(0.5 * (left + right), 2.0 * min(left, right))


@kernel
def stiffening(slopes):
    """What x grows by with the square of s/R beyond the last value; 0 for the linear organ, which has none."""
    return STIFFER * max(slopes[-1] - FLAT, 0.0) if len(slopes) > 1 else 0.0


@kernel
def risen(x, knots, slopes):
    """s/R [1] where the linear organ's is x [1], and its slope [1]; linear below 0, stiffer beyond the last value.

    knots, slopes [1] (L + 1)  x and dx/d(s/R) at s/R = 0, SPACING, 2 SPACING ..., see `rise`
    """
    last = len(knots) - 1
    if not x > 0.0:
        return x / slopes[0], 1.0 / slopes[0]
    if not x < knots[last]:
        first, more = slopes[last], stiffening(slopes)
        root = np.sqrt(first * first + 4.0 * more * (x - knots[last]))
        return last * SPACING + 2.0 * (x - knots[last]) / (first + root), 1.0 / root
    k = 0
    while x >= knots[k + 1]:
        k += 1
    climb, goal = knots[k + 1] - knots[k], x - knots[k]
    a, b = slopes[k] * SPACING, slopes[k + 1] * SPACING
    low, high = 0.0, 1.0
    t = goal / climb
    slope = climb
    for _ in range(60):  # Newton's method within a bracket
        u = 1.0 - t
        miss = climb * t * t * (3.0 - 2.0 * t) + a * t * u * u - b * t * t * u - goal
        slope = 6.0 * climb * t * u + a * u * (1.0 - 3.0 * t) + b * t * (3.0 * t - 2.0)
        if miss > 0.0:
            high = t
        else:
            low = t
        after = t - miss / slope
        if not low <= after <= high:
            after = 0.5 * (low + high)
        if abs(after - t) < 1e-14:
            break
        t = after
    return (k + t) * SPACING, SPACING / slope
