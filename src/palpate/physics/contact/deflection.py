"""Displacement of the surface of an elastic half-space under a contact patch, in units of the modulus.

A point force (Q_x, Q_y, P) at the origin of the surface, P into the half-space, displaces the surface at (x, y) by u,
with E* = E/(1 - nu²) (J. Boussinesq 1885, V. Cerruti 1882; K. L. Johnson, Contact Mechanics, 1985, eqs. 3.18 and 3.75)

    P:    E* u_x = -k x/r²,   E* u_z = 1/(pi r),   k = (1 - 2 nu)/(2 pi (1 - nu))
    Q_x:  E* u_x = (1/r + nu/(1 - nu) x²/r³)/pi,   E* u_y = nu x y/(pi (1 - nu) r³),   E* u_z = k x/r²

All fall as 1/r, so that in polar coordinates (s, theta) round the point the integral over a patch of pressure p has no
singularity: E* u = int g(theta) int p ds dtheta, with g = r E* u of the point force.
"""

import math

import numpy as np

from palpate.compiler.exact import arcsin, arctan2, cos, einsum, product, sin
from palpate.physics.contact.spread import kernel_values
from palpate.physics.kept import keep_results
from palpate.physics.special import gauss_legendre

ANGLES, ALONG = 128, 24  # quadrature points of theta (trapezoidal rule) and of s (Gauss)


@keep_results
def surface_under_patch(points: np.ndarray, radius: float, kernel: str, poisson: float) -> np.ndarray:
    """E* u [N/m per N = 1/m] (p,3,3) at points [m] (p,2) of the surface, relative to the centre of the patch: component
    of u, and of the force on the patch. kernel: shape of the load (`spread.KERNELS`), of this radius [m]."""
    points = np.asarray(points, float)
    away = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2)
    places, which = np.unique(np.round(away, 12), return_inverse=True)
    node, weight = gauss_legendre(400)
    q = 0.5 * (node + 1.0)
    total = math.pi * radius**2 * float(np.sum(weight * q * kernel_values(kernel, q)))  # of the kernel over the patch
    at_x = np.stack([_on_axis(r, radius, kernel, poisson) for r in places]) / total
    # The load is axisymmetric: the displacement at (x, y) is that at (r, 0), rotated.
    angle = arctan2(points[:, 1], points[:, 0])
    turned = np.zeros((len(points), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = cos(angle)
    turned[:, 1, 0], turned[:, 0, 1] = sin(angle), -sin(angle)
    turned[:, 2, 2] = 1.0
    half = einsum("pia,pab->pib", turned, at_x[which.ravel()])
    return einsum("pjb,pib->pij", turned, half)


def _on_axis(r: float, radius: float, kernel: str, poisson: float) -> np.ndarray:
    """Integral [m] (3,3) of E* u over a patch with the pressure k(d/R), at (r, 0)."""
    # Chords of the patch through the point: from the source at s = near to that at s = far, in the direction theta from
    # the point. Outside, the chords fill the angle 2 asin(R/r) around the direction of the centre.
    if r < radius:
        theta = 2.0 * math.pi * (np.arange(ANGLES) + 0.5) / ANGLES
        share = np.full(ANGLES, 2.0 * math.pi / ANGLES)
    else:
        node, weight = gauss_legendre(ANGLES)
        widest = float(arcsin(min(radius / r, 1.0)))
        theta, share = math.pi + widest * node, widest * weight
    c, s = cos(theta), sin(theta)
    root = np.sqrt(np.maximum(radius**2 - (r * s) ** 2, 0.0))
    near, far = np.maximum(-r * c - root, 0.0), np.maximum(-r * c + root, 0.0)
    node, weight = gauss_legendre(ALONG)
    along = near[:, None] + np.outer(far - near, 0.5 * (node + 1.0))
    apart = np.sqrt((r + along * c[:, None]) ** 2 + (along * s[:, None]) ** 2) / radius
    length = 0.5 * (far - near) * product(kernel_values(kernel, np.minimum(apart, 1.0)), weight) * share
    # From a source in the direction theta, the point lies in the direction (-c, -s).
    k, ratio = (1.0 - 2.0 * poisson) / (2.0 * math.pi * (1.0 - poisson)), poisson / (1.0 - poisson) / math.pi
    out = np.zeros((3, 3))
    out[0, 0] = np.sum(length * (1.0 / math.pi + ratio * c * c))
    out[1, 1] = np.sum(length * (1.0 / math.pi + ratio * s * s))
    out[2, 2] = np.sum(length) / math.pi
    out[2, 0], out[0, 2] = -k * np.sum(length * c), k * np.sum(length * c)
    return out
