"""Stress below a contact patch with normal and tangential load on an elastic half-space.

The stress at (x, y, z) due to a force (Q_x, Q_y, P) at the origin, P along z into the half-space, is (J. Boussinesq
1885, V. Cerruti 1882; K. L. Johnson, Contact Mechanics, 1985, eqs. 3.19 and 3.76), with rho² = x² + y² + z² and
s = rho + z,

    2 pi sigma_ij = -3 (Q.r) r_i r_j/rho⁵ + (1 - 2 nu) B_ij,    B_iz = 0

    P:    B_xx = z/rho³ - 1/(rho s) + x² (2 rho + z)/(rho³ s²),       B_xy = x y (2 rho + z)/(rho³ s²)
    Q_x:  B_xx = x/rho³ - 3 x/(rho s²) + x³ b,    B_yy = x/rho³ - x/(rho s²) + x y² b,    B_xy = -y/(rho s²) + x² y b
          b = 1/(rho³ s²) + 2/(rho² s³)

and the others by exchanging x and y. The load of a patch has a constant shape (`physics.contact.spread`), so the stress
at points fixed to the patch is a constant matrix times the force, which `under_patch` computes. It depends on Poisson's
ratio, not on the modulus, and is valid for the tissue and for the finger's skin, each with its Poisson's ratio, if they
are half-spaces at the scale of the patch.
"""

import math

import numpy as np

from palpate.compiler.exact import arctan2, cos, einsum, sin
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix, Vector3
from palpate.physics.contact.spread import kernel_values
from palpate.physics.friction.bristle import turn
from palpate.physics.kept import keep_results
from palpate.physics.special import gauss_legendre

SHALLOWEST = 0.01  # [1] Minimum depth over the patch's radius; at shallower points the stress is the surface load
PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # Components in Voigt order: xx, yy, zz, yz, xz, xy


def point_stress(points: np.ndarray, poisson: float) -> np.ndarray:
    """Stress [1/m²] (...,3,3,3) at points [m] (...,3), z > 0, per newton at the origin along x, y and z (last axis)."""
    x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
    rho = np.sqrt(x * x + y * y + z * z)
    s, rho3 = rho + z, rho * rho * rho
    r = np.stack([x, y, z], axis=-1)
    cubes = r[..., :, None, None] * r[..., None, :, None] * r[..., None, None, :]
    out = -3.0 * cubes / (rho * rho * rho3)[..., None, None, None]
    bend, pull = 1.0 / (rho3 * s**2) + 2.0 / (rho**2 * s * s * s), (2.0 * rho + z) / (rho3 * s**2)
    near, far = 1.0 / (rho * s**2), 1.0 / rho3
    more = 1.0 - 2.0 * poisson
    for a, b, u, v in ((0, 1, x, y), (1, 0, y, x)):
        out[..., a, a, a] += more * (u * far - 3.0 * u * near + u * u * u * bend)
        out[..., b, b, a] += more * (u * far - u * near + u * v * v * bend)
        out[..., a, a, 2] += more * (z * far - 1.0 / (rho * s) + u * u * pull)
        for i, j in ((a, b), (b, a)):
            out[..., i, j, a] += more * (-v * near + u * u * v * bend)
    for i, j in ((0, 1), (1, 0)):
        out[..., i, j, 2] += more * x * y * pull
    return out / (2.0 * math.pi)


@keep_results
def under_patch(points: np.ndarray, radius: float, kernel: str, poisson: float) -> np.ndarray:
    """Stress [1/m²] (p,3,3,3) at points [m] (p,3) per newton of load on the patch along x, y and z.

    points  x, y from the centre of the patch, and the depth z;  radius [m] of the kernel;  kernel: see `spread.KERNELS`

    Gaussian quadrature over the radius and the trapezoidal rule over the angle, finer for shallow points. ValueError: a
    depth below `SHALLOWEST` radii.
    """
    points = np.asarray(points, float)
    least = points[:, 2].min() / radius
    if not least >= SHALLOWEST:
        raise ValueError(f"depth {points[:, 2].min()} m: expected at least {SHALLOWEST * radius} m")
    node, weight = gauss_legendre(16 + math.ceil(1.6 / least))
    q = 0.5 * (node + 1.0)
    share = weight * q * kernel_values(kernel, q)
    round_ = 16 + math.ceil(12.0 / least)
    turn = 2.0 * math.pi * np.arange(round_) / round_
    source = radius * np.stack([np.outer(q, cos(turn)), np.outer(q, sin(turn))], axis=-1).reshape(-1, 2)
    share = np.repeat(share / (share.sum() * round_), round_)
    # the load is axisymmetric: the stress at (x, y) is that at (r, 0), rotated
    away = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2)
    places, which = np.unique(np.round(np.stack([away, points[:, 2]], axis=1), 12), axis=0, return_inverse=True)
    there = np.empty((len(places), 3, 3, 3))
    for k, (r, z) in enumerate(places):
        apart = np.column_stack([r - source[:, 0], -source[:, 1], np.full(len(source), z)])
        there[k] = np.sum(share[:, None, None, None] * point_stress(apart, poisson), axis=0)
    angle = arctan2(points[:, 1], points[:, 0])
    turned = np.zeros((len(points), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = cos(angle)
    turned[:, 1, 0], turned[:, 0, 1] = sin(angle), -sin(angle)
    turned[:, 2, 2] = 1.0
    found = there[which.ravel()]
    for place in ("pia,pabc->pibc", "pjb,pabc->pajc", "pkc,pabc->pabk"):
        found = einsum(place, turned, found)
    return found


@ieee_kernel
def first_axis(normal: Vector3):
    """Unit x axis (3) of a patch with this outward unit normal (3): along the projection of the world's x axis (y axis
    if the normal is within 37 degrees of x)."""
    n0, n1, n2 = normal[0], normal[1], normal[2]
    x0, x1, x2 = (1.0 - n0 * n0, -n0 * n1, -n0 * n2) if abs(n0) < 0.8 else (-n1 * n0, 1.0 - n1 * n1, -n1 * n2)
    long = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    return x0 / long, x1 / long, x2 / long


@kernel
def next_axis(axis: Vector3, before: Vector3, normal: Vector3):
    """Unit x axis (3) of a patch whose outward unit normal turns from `before` to `normal` (3): `axis` (3) under the
    smallest rotation between them (parallel transport). A rule by the normal alone would jump somewhere, because no
    field of tangents is continuous on a sphere. On a closed path the axis turns by the solid angle that the normals
    enclose. axis = 0: first call."""
    if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
        return first_axis(normal)
    if before[0] == normal[0] and before[1] == normal[1] and before[2] == normal[2]:
        return axis
    return turn(axis[0], axis[1], axis[2], before[0], before[1], before[2], normal[0], normal[1], normal[2])


@ieee_kernel
def along_patch(forces: Matrix, normal: Vector3, axis: Vector3):
    """The sum [N] of forces (k,3) along the axes of a patch with this outward normal (3): z into the tissue, x along
    `axis` (3), a unit tangent."""
    fx = fy = fz = 0.0
    for k in range(len(forces)):
        fx, fy, fz = fx + forces[k, 0], fy + forces[k, 1], fz + forces[k, 2]
    n0, n1, n2 = -normal[0], -normal[1], -normal[2]
    x0, x1, x2 = axis
    y0, y1, y2 = n1 * x2 - n2 * x1, n2 * x0 - n0 * x2, n0 * x1 - n1 * x0
    return fx * x0 + fy * x1 + fz * x2, fx * y0 + fy * y1 + fz * y2, fx * n0 + fy * n1 + fz * n2


@kernel
def response_to(force: Vector3, matrix: Matrix, out: Matrix):
    """Fill `out` (p,c) with a matrix (pc,3) times a force [N] (3): stresses [Pa] (p,6) with that of `under_patch`
    [1/m²], displacements [N/m] (p,3) with that of `deflection.surface_under_patch` [1/m]."""
    for p in range(len(out)):
        for c in range(out.shape[1]):
            row = matrix[out.shape[1] * p + c]
            out[p, c] = row[0] * force[0] + row[1] * force[1] + row[2] * force[2]


@kernel
def von_mises_of(stress: Matrix, out: Array):
    """Fill `out` [Pa] (p) with the equivalent stress of stresses [Pa] (p,6) in the order of `PAIRS`."""
    for p in range(len(stress)):
        s = stress[p]
        apart = (s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2
        out[p] = math.sqrt(0.5 * apart + 3.0 * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]))


@kernel
def energy_stress(xx: float, yy: float, zz: float, yz: float, xz: float, xy: float, poisson: float):
    """(1 + nu) sigma:sigma - nu tr(sigma)² = 2 E W [Pa²] of a stress [Pa]: W is the strain energy density."""
    square = xx * xx + yy * yy + zz * zz + 2.0 * (yz * yz + xz * xz + xy * xy)
    trace = xx + yy + zz
    return (1.0 + poisson) * square - poisson * trace * trace


@ieee_kernel
def strain_energy_of(stress: Matrix, young: float, poisson: float, out: Array):
    """Fill `out` [J/m³] (p) with the strain energy density of stresses [Pa] (p,6) in the order of `PAIRS`."""
    for p in range(len(stress)):
        s = stress[p]
        out[p] = energy_stress(s[0], s[1], s[2], s[3], s[4], s[5], poisson) / (2.0 * young)
