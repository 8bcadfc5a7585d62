"""How a soft slab answers a load that keeps its direction, the same where the surface sticks, and a rigid ball.

    python docs/studies/reduced_load.py [--json]

Two tables, E = 19 kPa, Poisson's ratio 0.45. A pressure (1 - d²/R²)², R = 8 mm, on a slab of 40 mm on its bed, by the
spacing of the surface's vertices under it: where equilibria end, the greatest pressure there over twice the shear
modulus, and the force over that of the linear organ at two indentations; with the surface free to slide, and sticking
as `palpate reduce` has it. Then a rigid ball of 15 mm without friction on a block: the force by depth over that on the
linear organ. Some minutes on one core.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import beside  # noqa: F401
import numpy as np
from scipy.spatial import Delaunay
from tables import tell

from palpate.models.fe import Rigid, Settings, Solver, neo_hooke, quadratic, sphere
from palpate.models.fe.element.mesh import bricks, grid
from palpate.models.fe.meshing.organ import SLAB, Organ
from palpate.models.fe.reduce.dents import RADIUS, patch, sticking
from palpate.models.fe.reduce.indentation import Press
from palpate.models.fe.reduce.reducible import of_organ
from palpate.physics.bodies.dents import hat_moments, patch_radius
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import Material
from palpate.physics.materials.linear import linear

YOUNG, POISSON = 19e3, 0.45
SHEAR = YOUNG / (2.0 * (1.0 + POISSON))
SPACINGS = (5e-3, 3.5e-3, 2.5e-3)
HALF = 50e-3
"""[m] Half the width of slab and block."""
DEPTHS = 0.5e-3 * np.arange(1, 21)
AT = (2e-3, 3e-3)
BALL, CELLS = 15e-3, 10


def level(spacing: float) -> Mesh:
    """A square whose vertices lie on rings, this far apart within 9 mm of the middle, farther outside."""
    rings, r, size = [np.zeros((1, 2))], 0.0, spacing
    while r + size < 0.92 * HALF:
        r += size
        count = max(6, round(2 * np.pi * r / size))
        angle = 2 * np.pi * np.arange(count) / count + 0.1 * len(rings)
        rings.append(r * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        if r > 9e-3:
            size *= 1.35
    side = np.linspace(-HALF, HALF, 9)[:-1]
    whole = np.full(8, HALF)
    rim = [np.stack(p, axis=1) for p in ((side, -whole), (whole, side), (-side, whole), (-whole, -side))]
    points = np.concatenate([*rings, *rim])
    triangles = Delaunay(points).simplices
    a, b = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    triangles[turned < 0] = triangles[turned < 0][:, ::-1]
    kept = triangles[np.abs(turned) > 1e-10].astype(np.int32)
    return Mesh(np.column_stack([points, np.zeros(len(points))]), kept)


def pressed(spacing: float) -> list[dict[str, object]]:
    """The patch, free to slide and sticking."""
    organ = of_organ(Organ(level(spacing), POISSON))
    surface = organ.surface
    foot, up = np.array([0.3 * spacing, 0.2 * spacing, 0.0]), np.array([0.0, 0.0, 1.0])
    unit = patch(surface, foot, up, RADIUS)
    every = np.arange(len(surface.vertices))
    across = patch_radius(surface.vertices, hat_moments(surface), every, len(every), -unit[:, 2:])
    model, hats = Press(organ), organ.hats
    held = {"free": None, "sticks": sticking(hats, unit)}
    curves = model.run([model.curve(hats @ unit, DEPTHS, h) for h in held.values()])
    rows: list[dict[str, object]] = []
    for name, curve in zip(held, curves, strict=True):
        last = int(np.isfinite(curve.force).sum()) - 1
        force = YOUNG * float(curve.force[last])
        ratio = curve.force / (curve.stiffness * DEPTHS)
        rows.append(
            {
                "spacing mm": 1e3 * spacing,
                "patch R mm": 1e3 * across,
                "surface": name,
                "last mm": 1e3 * float(DEPTHS[last]),
                "N": force,
                "pressure / 2G": 3.0 * force / (np.pi * across**2) / (2.0 * SHEAR),
                **{f"f / linear at {1e3 * d:g} mm": float(ratio[np.searchsorted(DEPTHS, d - 1e-9)]) for d in AT},
            }
        )
    return rows


def ball(material: Material, depths: np.ndarray) -> np.ndarray:
    """Force [N] of a rigid ball at these depths; a quarter of the block is meshed, its foot held."""
    across = HALF * np.linspace(0.0, 1.0, CELLS + 1) ** 1.6
    points, cells = grid(across, across, -SLAB * np.linspace(1.0, 0.0, 2 * CELLS // 3 + 1) ** 1.6)
    corners = bricks(points, cells)
    mesh = quadratic(points, corners, np.zeros(len(corners), dtype=np.int64))
    x, y, z = mesh.points.T
    fixed = np.stack([x < 1e-9, y < 1e-9, np.zeros_like(z, dtype=bool)], axis=1)
    fixed[z < -SLAB * (1 - 1e-9)] = True
    faces = mesh.points[mesh.faces]
    top = mesh.faces[(faces[:, :, 2] > -1e-9).all(axis=1) & (np.hypot(*faces.mean(axis=1)[:, :2].T) < 0.5 * HALF)]
    rigid = Rigid(top, sphere, (BALL,), lambda depth: np.array([0.0, 0.0, BALL - depth]), bound=2e-5)
    steps = Settings(tolerance=1e-5, step=2e-4, largest=1e-3, least=1e-6)
    body = Solver(mesh, {0: replace(material, mixed=False)}, fixed, contacts=[rigid], settings=steps)
    forces = []
    for depth in depths:
        body.advance(float(depth))
        forces.append(-4.0 * float(rigid.force[2]))
    return np.array(forces)


def balls() -> list[dict[str, object]]:
    """The ball on the linear block and on the nonlinear one."""
    depths = 2e-3 * np.arange(1, 6)
    plain, large = (ball(material, depths) for material in (linear(YOUNG, POISSON), neo_hooke(YOUNG, POISSON)))
    return [
        {"depth mm": 1e3 * d, "linear N": f, "nonlinear over it": g / f}
        for d, f, g in zip(depths.tolist(), plain.tolist(), large.tolist(), strict=True)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    shown = {
        "a pressure that keeps its direction": [row for spacing in SPACINGS for row in pressed(spacing)],
        "a rigid ball": balls(),
    }
    tell(shown, given.json, digits=2)


if __name__ == "__main__":
    main()
