"""A rigid sphere on an elastic block, and an elastic ball on a rigid plane, compared with Hertz's theory."""

from __future__ import annotations

import numpy as np

from palpate.models.fe import RigidIndenter, Settings, Solver, linear, plane, quadratic, sphere
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.faces import HATS
from palpate.models.fe.element.mesh import bricks, grid

YOUNG, RADIUS = 1e4, 0.01
SIZE = 30.0
"""[1] Size of the meshed part, in contact radii."""


def indented(poisson: float, faces: int, ratio: float, ball: bool = False) -> dict[str, float]:
    """Force and area over theory; `ratio`: approach over radius, `faces`: faces across the contact radius.

    A quarter of the body is meshed up to `SIZE`. On this boundary the displacement is that of a point force on a
    half-space (Boussinesq), to which Hertz's field decays. So the mesh represents a half-space or, with `ball`, the
    ball of the theory; a ball fixed at its equator would be stiffer.
    """
    # graded mesh of a quarter, fine at the contact
    depth = ratio * RADIUS
    a = np.sqrt(RADIUS * depth)
    h = a / faces
    x = h * np.arange(int(1.4 * faces) + 1)
    z = [0.0]
    while x[-1] < SIZE * a:
        x = np.append(x, x[-1] + 2.2 * (x[-1] - x[-2]))
    while z[-1] < SIZE * a:
        z.append(z[-1] + h)
        h *= 1.8
    points, cells = grid(x, x, -np.array(z[::-1]))
    mesh = quadratic(points, bricks(points, cells))
    # symmetry planes and far boundary
    p, near = mesh.points, 1e-9 * a
    far = (p[:, 0] > x[-1] - near) | (p[:, 1] > x[-1] - near) | (p[:, 2] < near - z[-1])
    fixed = np.stack([(p[:, 0] < near) | far, (p[:, 1] < near) | far, far], axis=1)
    top = mesh.faces[(p[mesh.faces][:, :, 2] > -near).all(axis=1)]
    if ball:
        away = np.hypot(p[:, 0], p[:, 1])
        p[:, 2] -= (RADIUS - np.sqrt(RADIUS**2 - away**2)) * (1 + p[:, 2] / z[-1])
    # F = 4/3 E/(1 - nu²) sqrt(R) d^(3/2), and the far field of this force
    theory = 4.0 / 3.0 * YOUNG / (1 - poisson**2) * np.sqrt(RADIUS) * depth**1.5
    held = np.zeros_like(p)
    held[far] = theory * point_force(p[far], YOUNG, poisson)
    top = top[np.linalg.norm(p[top[:, :3]].mean(axis=1), axis=1) < 2.2 * a]
    if ball:
        shape, numbers, z = plane, (0, 0, -1.0), 0.0
    else:
        shape, numbers, z = sphere, (RADIUS,), RADIUS
    touch = RigidIndenter(top, shape, numbers, lambda load: np.array([0, 0, z - load * depth]), bound=depth / 1000)
    steps = Settings(step=1.0, largest=1.0)
    body = Solver(mesh, {0: linear(YOUNG, poisson)}, fixed, lambda load: load * held, contacts=[touch], settings=steps)
    body.advance(1.0)
    # compare with p = p0 sqrt(1 - r²/a²), p0 = 3F/(2 pi a²)
    value, _ = face_rule.shape(face_rule.POINTS)
    place = np.einsum("qa,fai->fqi", value, p[touch.faces])
    right = 1.5 * theory / (np.pi * a * a) * np.sqrt(np.maximum(1.0 - (np.linalg.norm(place, axis=2) / a) ** 2, 0.0))
    field = touch.nodal_pressure(body.displacement)[touch.faces[:, :3]] @ HATS.T
    norm = (touch.area * right**2).sum()
    points_off, field_off = (
        float(np.sqrt((touch.area * (pressure - right) ** 2).sum() / norm)) for pressure in (touch.traction, field)
    )
    return {
        "degrees of freedom": 3 * len(p),
        "force/Hertz": 4 * abs(float(touch.force[2])) / theory,
        "area/Hertz": 4 * touch.contact_area(body.displacement) / (np.pi * a**2),
        "penetration/depth": float(-touch.gap.min()) / depth,
        "pressure at the points, L2": points_off,
        "pressure field, L2": field_off,
    }


def point_force(points: np.ndarray, young: float, poisson: float) -> np.ndarray:
    """Displacement [m] (n,3) of the half-space z < 0 under a unit force [N] at the origin, along -z.

    points  (n,3) [m]
    young   modulus [Pa]

    K. L. Johnson, Contact Mechanics, Cambridge 1985, eq. 3.18.
    """
    shear = young / (2 * (1 + poisson))
    r, down = np.linalg.norm(points, axis=1), -points[:, 2]
    out = down / r**3 - (1 - 2 * poisson) / (r * (r + down))
    sink = down**2 / r**3 + 2 * (1 - poisson) / r
    return np.stack([out * points[:, 0], out * points[:, 1], -sink], axis=1) / (4 * np.pi * shear)
