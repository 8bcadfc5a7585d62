"""A steel ball pressed into skin over fat: a custom material law, two layers, contact, a file for ParaView.

python press.py [folder]    (the file needs the extra `mesh`)
"""

import sys
from pathlib import Path

import numba
import numpy as np

from palpate.models.fe import Material, RigidIndenter, Settings, Solver, TetMesh, neo_hooke, quadratic, sphere
from palpate.models.fe.element.files import write_vtu
from palpate.models.fe.element.mesh import bricks, grid
from palpate.physics.materials.hyperelastic import moduli
from palpate.physics.materials.invariants import shape_invariants, shape_stress

SIDE, FAT, SKIN = 16e-3, 9e-3, 1e-3  # [m]; a quarter of the block is meshed
BALL, DEPTH = 4e-3, 2e-3  # [m]


@numba.njit(cache=True)
def stiffening(F, J, p, P, A):
    """W = mu/(2b) (exp(b I) - 1) with I = J^(-2/3) I1 - 3, U = kappa/2 (J - 1)²: skin, stiffer when stretched.

    Y. C. Fung, Am. J. Physiol. 213 (1967) 1532-1544.
    """
    shear, bulk, b = p
    _, stretch, _ = shape_invariants(F)
    w1 = 0.5 * shear * np.exp(b * stretch)  # dW/dI; the law does not depend on the second invariant
    shape_stress(F, w1, 0.0, b * w1, 0.0, 0.0, P, A)
    return (w1 - 0.5 * shear) / b, 0.5 * bulk * (J - 1.0) ** 2, bulk * (J - 1.0), bulk


def block(cells: int) -> TetMesh:
    """A quarter of the block with its top at z = 0, finest under the ball; region 0 is fat, region 1 skin."""
    across = SIDE * np.linspace(0.0, 1.0, cells + 1) ** 1.6
    up = np.concatenate([-SKIN - FAT * np.linspace(1.0, 0.0, cells) ** 1.6, [-SKIN / 2, 0.0]])
    points, bricked = grid(across, across, up)
    corners = bricks(points, bricked)
    return quadratic(points, corners, (points[corners].mean(axis=1)[:, 2] > -SKIN).astype(np.int64))


def press(law: Material, depths: np.ndarray, cells: int = 6) -> tuple[Solver, list[float], list[float]]:
    """The solver after the last depth, and force [N] and contact area [m²] of the whole ball at these depths [m]."""
    mesh = block(cells)
    x, y, z = mesh.points.T
    fixed = np.stack([x < 1e-9, y < 1e-9, np.zeros_like(z, dtype=bool)], axis=1)
    fixed[z < -(FAT + SKIN) * (1 - 1e-9)] = True
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > -1e-9).all(axis=1)]
    ball = RigidIndenter(top, sphere, (BALL,), path=lambda depth: np.array([0.0, 0.0, BALL - depth]))
    steps = Settings(step=1e-4, largest=4e-4, least=1e-7)  # in the unit of the load: here [m]
    body = Solver(mesh, {0: neo_hooke(5e3, 0.48), 1: law}, fixed, contacts=[ball], settings=steps)
    forces, areas = [], []
    for depth in depths:
        body.advance(float(depth))
        forces.append(-4.0 * float(ball.force[2]))
        areas.append(4.0 * ball.contact_area(body.displacement))
    return body, forces, areas


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    if not folder.is_dir():
        sys.exit(f"{folder}: this folder does not exist")
    shear, bulk = moduli(30e3, 0.48)
    skins = {"neo-Hookean": neo_hooke(30e3, 0.48), "stiffening": Material(stiffening, (shear, bulk, 10.0), mixed=True)}
    depths = np.linspace(0.0, DEPTH, 5)[1:]
    for name, skin in skins.items():
        body, forces, areas = press(skin, depths)
        print(f"{name} skin")
        for depth, force, area in zip(depths, forces, areas, strict=True):
            print(f"  {1e3 * depth:.2f} mm  {1e3 * force:6.2f} mN  {1e6 * area:5.2f} mm²")
        fields = {"displacement": body.displacement, "pressure": body.contacts[0].nodal_pressure(body.displacement)}
        write_vtu(folder / f"{name}.vtu", body.mesh, fields)
    print(f"written: {', '.join(str(folder / f'{name}.vtu') for name in skins)}")


if __name__ == "__main__":
    main()
