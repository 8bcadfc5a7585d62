"""A rigid ball pressed into an elastic half-space by `fe.Solver`: contact, not a patch.

A quarter is meshed up to `SIZE` radii of contact. There it is held to the field of a point force on a half-space
(K. L. Johnson, Contact Mechanics, Cambridge 1985, eq. 3.18), which is what is left of Hertz's so far away.
"""

import math
import time
from dataclasses import dataclass

import numpy as np

from palpate.models.fe.contact.rigid import Rigid, sphere
from palpate.models.fe.element.mesh import bricks, grid, quadratic
from palpate.models.fe.solve.solver import Settings, Solver
from palpate.physics.materials.linear import linear
from palpate.studies.peers.continuum import POISSON, RADIUS, YOUNG

SIZE = 25.0
"""[1]"""
DEPTHS = 5e-4 * np.array([0.25, 0.5, 0.75, 1.0])
"""[m]"""


@dataclass(frozen=True)
class HalfSpaceResult:
    """Force [N], area of contact [m²] at `DEPTHS`; seconds of each load step."""

    force: np.ndarray
    area: np.ndarray
    unknowns: int
    seconds: np.ndarray


def press(faces: int) -> HalfSpaceResult:
    """With so many faces over the greatest radius of contact."""
    a = math.sqrt(RADIUS * float(DEPTHS[-1]))
    size = a / faces
    x = [size * k for k in range(int(1.4 * faces) + 2)]
    while x[-1] < SIZE * a:
        x.append(x[-1] + 2.0 * (x[-1] - x[-2]))
    z, step = [0.0], size
    while z[-1] < SIZE * a:
        z.append(z[-1] + step)
        step *= 1.7
    points, cells = grid(np.array(x), np.array(x), -np.array(z[::-1]))
    mesh = quadratic(points, bricks(points, cells))
    p, near = mesh.points, 1e-9 * a
    far = (p[:, 0] > x[-1] - near) | (p[:, 1] > x[-1] - near) | (p[:, 2] < near - z[-1])
    fixed = np.stack([(p[:, 0] < near) | far, (p[:, 1] < near) | far, far], axis=1)
    top = mesh.faces[(p[mesh.faces][:, :, 2] > -near).all(axis=1)]
    top = top[np.linalg.norm(p[top[:, :3]].mean(axis=1), axis=1) < 2.2 * a]
    unit = np.zeros_like(p)
    unit[far] = point_force(p[far], YOUNG, POISSON)
    theory = 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * math.sqrt(RADIUS)
    ball = Rigid(top, sphere, (RADIUS,), lambda d: np.array([0.0, 0.0, RADIUS - d]), bound=float(DEPTHS[0]) / 1000)
    body = Solver(
        mesh, {0: linear(YOUNG, POISSON)}, fixed, lambda d: theory * d**1.5 * unit, contacts=[ball],
        settings=Settings(step=2e-4, largest=2e-4, least=1e-7),
    )  # fmt: skip
    force, area, seconds = [], [], []
    for depth in DEPTHS:
        begun = time.perf_counter()
        body.advance(float(depth))
        seconds.append(time.perf_counter() - begun)
        force.append(4.0 * abs(float(ball.force[2])))
        area.append(4.0 * ball.contact_area(body.displacement))
    return HalfSpaceResult(np.array(force), np.array(area), p.size, np.array(seconds))


def point_force(points: np.ndarray, young: float, poisson: float) -> np.ndarray:
    """Displacement [m] (n,3) of the half-space z < 0 of a modulus [Pa] by a unit force [N] at the origin, into it."""
    shear = young / (2 * (1 + poisson))
    r, down = np.linalg.norm(points, axis=1), -points[:, 2]
    out = down / r**3 - (1 - 2 * poisson) / (r * (r + down))
    sink = down**2 / r**3 + 2 * (1 - poisson) / r
    return np.stack([out * points[:, 0], out * points[:, 1], -sink], axis=1) / (4 * np.pi * shear)
