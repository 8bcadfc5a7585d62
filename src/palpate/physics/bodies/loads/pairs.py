"""What two patches on a condensed organ have in common: the half-space between their true loads, and that they stick.

The formulas are those of `physics.bodies.condensed_contacts`: Y, X - g_i.T g_j, and what the compliance between two
patches loses because each is held by tangential forces.
"""

import numpy as np

from palpate.compiler.exact import cos, product
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.kept import keep_results
from palpate.physics.special import gauss_legendre, patch_depth

STEP, FARTHEST = 1.0 / 32.0, 6.0  # [1] Step and end of the table of Y over d/R


@keep_results
def joint_profile() -> np.ndarray:
    """Y at rho = 0, STEP ... FARTHEST: the mean of W (`true_patch.depth_profile`) over a patch at the distance rho, by
    the Gauss-Legendre rule over its radius and the trapezoidal rule over the angle."""
    rho = np.arange(0.0, FARTHEST + 0.5 * STEP, STEP)
    node, weight = gauss_legendre(32)
    r = 0.5 * (node + 1.0)
    weight = 0.5 * weight * 6.0 * r * (1.0 - r * r) ** 2
    turn = (np.arange(64) + 0.5) * np.pi / 64
    away = np.sqrt(rho[:, None, None] ** 2 + r[:, None] ** 2 + 2.0 * rho[:, None, None] * r[:, None] * cos(turn))
    return product(patch_depth(away).mean(axis=2), weight)


@kernel
def between(i: int, j: int, profile: Array, contacts: Record, feet: Matrix, hats: float):
    """Mean 1/r [1/m] between two true patches minus that of the hat functions; derivative over the distance [1/m³]."""
    radius = np.sqrt(0.5 * (contacts[i].radius ** 2 + contacts[j].radius ** 2))
    away = 0.0
    for x in range(3):
        away += (feet[i, x] - feet[j, x]) ** 2
    away = np.sqrt(away)
    mean, change = _mean_inverse(profile, away / radius)
    return mean / radius - hats, change / (radius * radius * max(away, 1e-12))


@kernel
def _mean_inverse(profile: Array, rho: float):
    """Y and its derivative at rho [1], by linear interpolation of the table, and the asymptote beyond its end."""
    at = rho / STEP
    k = int(at)
    if k + 1 >= len(profile):
        return (1.0 + 0.125 / (rho * rho)) / rho, -(1.0 + 0.375 / (rho * rho)) / (rho * rho)
    rise = profile[k + 1] - profile[k]
    return profile[k] + (at - k) * rise, rise / STEP


@kernel
def hats(i: int, j: int, table: Matrix, marks: Indices, counts: Indices, shares: Matrix, near: Matrix):
    """Mean 1/r [1/m] between the hat functions of two patches; fills in that of each vertex of the first, `near`."""
    total = 0.0
    for k in range(counts[i, 1]):
        v = marks[i, 2, k]
        mean = 0.0
        for q in range(counts[j, 1]):
            b = marks[j, 2, q]
            mean += table[v, b] * shares[j, b]
        near[i, v] = mean
        total += shares[i, v] * mean
    return total


@kernel
def sticking(
    model: Record,
    profile: Array,
    marks: Indices,
    contacts: Record,
    counts: Indices,
    normals: Matrix,
    feet: Matrix,
    shares: Matrix,
    near: Matrix,
    held: Matrix,
):
    """Reduction [m/N] (c,c) of the compliances between patches because they stick, for a modulus of 1 Pa; its diagonal
    is zero, as c_ii includes it. 0 if patches slide. Fills `held` [1] (c,3), the tangential forces that hold them."""
    many, compliance, true = len(counts), model.compliance, model.true
    lost, block = np.zeros((many, many)), np.zeros((3, 3))
    held[:] = 0.0
    if not true.sticks:
        return lost
    for i in range(many):
        holding(contacts[i].holds, normals[i], held[i])
        for j in range(i):
            if contacts[i].organ or contacts[j].organ:  # its patch is another when it parts, but not its history
                continue
            # g_i.C g_j, in C_tt with the correction
            block[:] = 0.0
            for k in range(counts[i, 1]):
                v = marks[i, 2, k]
                for q in range(counts[j, 1]):
                    b = marks[j, 2, q]
                    both = shares[i, v] * shares[j, b]
                    for x in range(3):
                        for y in range(3):
                            block[x, y] += both * compliance[3 * v + x, 3 * b + y]
            common = hats(i, j, true.table, marks, counts, shares, near)
            more = true.tangential * true.normal * between(i, j, profile, contacts, feet, common)[0]
            total = 0.0
            for x in range(3):
                total += held[i, x] * more * held[j, x]
                for y in range(3):
                    along = normals[i, x] * held[j, y] + held[i, x] * normals[j, y] + held[i, x] * held[j, y]
                    total += block[x, y] * along
            lost[i, j] = lost[j, i] = -total
    return lost


@kernel
def holding(holds: Record, normal: Vector3, held: Array):
    """Fill the tangential force [1] (3) that holds a patch under a unit normal force."""
    a, b, d = holds.own[0, 0], holds.own[0, 1], holds.own[1, 1]
    y, z = holds.cross[0], holds.cross[1]
    det = a * d - b * b
    held[:] = 0.0
    if det > 0.0:
        axes = np.zeros((2, 3))
        sideways(normal, axes)
        for x in range(3):
            held[x] = -((d * y - b * z) * axes[0, x] + (a * z - b * y) * axes[1, x]) / det
