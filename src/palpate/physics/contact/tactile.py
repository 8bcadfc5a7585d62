"""Tactile flow: equivalent strain, isostrain volumes and their growth with force, motion of the isostrain surfaces."""

import numpy as np

from palpate.compiler.exact import power
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix

FLOOR = 1e-3
LEAST_STRETCH = 1e-6  # Lower limit of stretches, for points that are inverted by the discretization


def equivalent_strain(gradient: np.ndarray, poisson: float | np.ndarray = 0.5) -> np.ndarray:
    """Equivalent (von Mises) logarithmic strain [1] (...) of deformation gradients F [1] (...,3,3); 0 for rigid motion.

        e = [((e1 - e2)² + (e2 - e3)² + (e3 - e1)²)/2]^(1/2)/(1 + nu),    e_i = ln of the principal stretches

    poisson  [1] () or (...) effective ratio, in (-1, 0.5]: the material's for an elastic material (then e is stress/E),
             0.5 for an incompressible or plastic one

    ANSYS Mechanical APDL Theory Reference, "Combined strains".
    """
    squares = np.linalg.eigvalsh(np.swapaxes(gradient, -1, -2) @ gradient)
    log = 0.5 * np.log(np.maximum(squares, LEAST_STRETCH**2))
    log -= log.mean(axis=-1, keepdims=True)
    return np.sqrt(1.5 * np.sum(log * log, axis=-1)) / (1.0 + np.asarray(poisson))


def isostrain_volume(values: np.ndarray, volumes: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Volume [m³] (L,) in which the strain is at least each of `levels` [1] (L,), exact for a strain that is linear in
    each tetrahedron: `values` [1] (E,4) at its corners, `volumes` [m³] (E,)."""
    values = np.sort(np.asarray(values, dtype=np.float64), axis=1)
    return _volume(values, np.asarray(volumes, dtype=np.float64), np.atleast_1d(np.asarray(levels, dtype=np.float64)))


@kernel
def _volume(values: Matrix, volumes: Array, levels: Array):
    volume_above = np.zeros(len(levels))
    for k in range(len(levels)):
        c = levels[k]
        for e in range(len(values)):
            v0, v1, v2, v3 = values[e, 0], values[e, 1], values[e, 2], values[e, 3]
            if c <= v0:
                share = 1.0
            elif c > v3:
                share = 0.0
            elif c <= v1:
                share = 1.0 - (c - v0) / (v1 - v0) * (c - v0) / (v2 - v0) * (c - v0) / (v3 - v0)
            elif c <= v2:
                # the part above is a wedge on the edge from corner 2 to corner 3, cut into three tetrahedra
                a, b = (v2 - c) / (v2 - v0), (v2 - c) / (v2 - v1)
                p, q = (v3 - c) / (v3 - v0), (v3 - c) / (v3 - v1)
                share = p * q + a * b * (1.0 - q) + a * q * (1.0 - p)
            else:
                share = (v3 - c) / (v3 - v0) * (v3 - c) / (v3 - v1) * (v3 - c) / (v3 - v2)
            volume_above[k] += share * volumes[e]
    return volume_above


def growth(low: np.ndarray, high: np.ndarray, force_low: float, force_high: float) -> np.ndarray:
    """(high - low)/(force_high - force_low): growth with force of volumes [m³/N] or of the contact area [m²/N].
    ValueError: the forces are equal."""
    if not force_high != force_low:
        raise ValueError(f"growth between equal forces, {force_low} N: expected two different ones")
    return (np.asarray(high) - np.asarray(low)) / (force_high - force_low)


def tactile_flow(
    points: np.ndarray, low: np.ndarray, high: np.ndarray, force_low: float, force_high: float
) -> np.ndarray:
    """Motion of the isostrain surfaces with force, along the strain gradient, in each tetrahedron [m/N] (E,3).

        phi = -(de/dP) grad e/max(|grad e|², g²)

    Motion within a surface is undetermined and set to 0. g, `FLOOR` times the largest gradient, bounds the flow where
    the strain is constant. points [m] (E,4,3) corners; low, high [1] (E,4) strain there at the two forces [N].

    A. Bicchi et al., Brain Res. Bull. 75 (2008) 737-741.
    """
    points = np.asarray(points, dtype=np.float64)
    middle = 0.5 * (np.asarray(low) + np.asarray(high))
    edges = points[:, 1:] - points[:, :1]
    slope = np.linalg.solve(edges, (middle[:, 1:] - middle[:, :1])[..., None])[..., 0]
    square = np.sum(slope * slope, axis=1)
    change = np.mean(growth(low, high, force_low, force_high), axis=1)
    least = max(FLOOR**2 * float(square.max(initial=0.0)), 1e-300)
    return -(change / np.maximum(square, least))[:, None] * slope


def stick_radius(radius: float, tangential: float, normal: float, friction: float) -> float:
    """Radius of the sticking part of a contact circle [m]: a (1 - Q/(mu P))^(1/3), 0 in full slip; a [m], tangential
    Q >= 0 [N], normal P >= 0 [N], friction mu > 0 [1]. R. D. Mindlin, J. Appl. Mech. 16 (1949) 259-268."""
    if not normal > 0.0:
        return 0.0
    return radius * float(power(max(0.0, 1.0 - tangential / (friction * normal)), 1.0 / 3.0))
