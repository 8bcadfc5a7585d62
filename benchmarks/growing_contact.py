"""Accuracy of contacts that grow with the force: deformation.ReducedFE under a rigid ball and a soft fingertip.

    python benchmarks/growing_contact.py                 # ball against Hertz; fingertip against full finite elements
    python benchmarks/growing_contact.py --slab 19e3     # softer slab

Ball: the reference is Hertz's theory of a half-space; the body is the slab of `bench accuracy`, so the error includes
the finite thickness. Fingertip: a neo-Hookean paraboloid pad of 8 mm radius and 12 mm thickness, bonded to a bone,
presses the same slab on its elastic foundation; both are deformable (`fe.Pair`, without friction). A second run presses
the pad on a rigid plate. It yields the compression of the finger and the contact radius a_p(f) for the area law a³ =
a_p³ + 3 f R/4E*. The indentation of the body is compared with that of the slab, d = integral of dV/f over its energy V;
the force at a given approach of the bone includes the compression of the pad on the plate, as in contact.Series.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from palpate.models.fe import ElasticFoundation, Pair, RigidIndenter, Settings, Solver, plane, quadratic
from palpate.models.fe.element.mesh import TetMesh, bricks, grid
from palpate.models.fe.solve.body import ElasticBody
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.condensed_body import answer, bear, condensed_body
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.contact.area import FIXED, AreaLaw, ball, of_table, radius_at
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.peers.continuum import BED, POISSON, RADIUS, SIDE, SLAB, YOUNG, grade_axis

UP, FOOT = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
WIDE, THICK = 9.5e-3, 12e-3  # [m] half width of the pad, and its thickness on the axis
FORCES = np.geomspace(0.05, 2.5, 30)  # [N] forces at which the curves are compared
STEPS = Settings(tolerance=1e-5, step=2e-4, largest=4e-4, least=1e-6)
QUARTERS = 4.0


def indentations(area: AreaLaw, young: float, forces: np.ndarray) -> np.ndarray:
    """Indentations [m] of the body at forces [N]."""
    node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=10000)
    mesh, basis = node.mesh(), node.basis()
    body = condensed_body(basis, mesh, young, 0.0, RADIUS, 0.02, POISSON, rho=nonlinearity(POISSON), area=area)
    patch, found = spreader(mesh, RADIUS, "hertz" if len(area.forces) else "biweight"), []
    for force in forces:
        wide = radius_at(area.forces, area.radii, force) if len(area.forces) else 0.0
        count = spread(patch, FOOT, UP, (0.0, 0.0, -float(force)), wide)
        bear(body, 0, patch.nodes[:count], patch.forces[:count], FOOT, UP, 1.0)
        answer(body, np.zeros((1, 5)), 1.0)
        found.append(float(body.contacts[0]["now"]))
    return np.array(found)


def pad(size: float) -> TetMesh:
    """A quarter of the pad, its apex at the origin."""
    x = grade_axis(0.0, 0.0, WIDE, WIDE, size)
    z = grade_axis(0.0, 0.0, 4.0 * size, THICK, size)
    points, cells = grid(x, x, z)
    mesh = quadratic(points, bricks(points, cells))
    p = mesh.points
    p[:, 2] += (p[:, 0] ** 2 + p[:, 1] ** 2) / (2.0 * RADIUS) * (1.0 - p[:, 2] / THICK)
    return mesh


def slab(size: float) -> TetMesh:
    """A quarter of the slab, its top at z = 0."""
    x = grade_axis(0.0, 0.0, WIDE, SIDE / 2, size)
    points, cells = grid(x, x, grade_axis(-SLAB, -4.0 * size, 0.0, 0.0, size))
    return quadratic(points, bricks(points, cells))


def faces_at(mesh: TetMesh, flags: np.ndarray) -> np.ndarray:
    """Boundary faces (F,6) of which all corners are flagged (N,)."""
    return mesh.faces[flags[mesh.faces[:, :3]].all(axis=1)]


def run(
    solver: Solver, touch: Pair | RigidIndenter, energy: object = None, most: float = float(FORCES[-1])
) -> np.ndarray:
    """Approach [m], force [N], contact radius [m] and energy of the slab [J] (4,n), up to a force of `most` [N]."""
    rows = [(0.0, 0.0, 0.0, 0.0)]
    while rows[-1][1] < most:
        begun = time.perf_counter()
        solver.advance(max(1.18 * rows[-1][0], 2e-4))
        area = QUARTERS * touch.contact_area(solver.displacement)
        stored = QUARTERS * energy(solver.displacement) if energy else 0.0  # type: ignore[operator]
        rows.append((solver.load, QUARTERS * abs(float(touch.force[2])), math.sqrt(area / math.pi), stored))
        print("  approach {:.2f} mm, {:.3f} N, a {:.2f} mm".format(*np.multiply(rows[-1][:3], (1e3, 1.0, 1e3))),
              f"({time.perf_counter() - begun:.0f} s)", flush=True)  # fmt: skip
    return np.array(rows).T


def on_plate(finger: float, size: float) -> np.ndarray:
    """The pad on a rigid plate that rises."""
    mesh = pad(size)
    p = mesh.points
    fixed = np.stack([p[:, 0] < 1e-9, p[:, 1] < 1e-9, np.zeros(len(p), bool)], axis=1) | (p[:, 2:] > THICK - 1e-9)
    below = faces_at(mesh, p[:, 2] < (p[:, 0] ** 2 + p[:, 1] ** 2) / (2.0 * RADIUS) + 1e-9)
    touch = RigidIndenter(below, plane, (0.0, 0.0, 1.0), lambda load: np.array([0.0, 0.0, load]), bound=2e-6)
    return run(Solver(mesh, {0: neo_hooke(finger, POISSON)}, fixed, contacts=[touch], settings=STEPS), touch)


def with_pad(block: TetMesh, tip: TetMesh) -> TetMesh:
    """The block, region 0, and the pad, region 1, whose nodes follow."""
    return TetMesh(
        np.concatenate([block.points, tip.points]), np.concatenate([block.elements, tip.elements + len(block.points)]),
        np.repeat([0, 1], [len(block.elements), len(tip.elements)]),
    )  # fmt: skip


def on_slab(finger: float, young: float, size: float) -> np.ndarray:
    """The pad pressed into the slab by its bone."""
    tip, block = pad(size), slab(size)
    count = len(block.points)
    mesh = with_pad(block, tip)
    p, of_tip = mesh.points, np.arange(len(mesh.points)) >= count
    bone = of_tip & (p[:, 2] > THICK - 1e-9)
    fixed = np.stack([p[:, 0] < 1e-9, p[:, 1] < 1e-9, np.zeros(len(p), bool)], axis=1) | bone[:, None]
    pulp = of_tip & (p[:, 2] < (p[:, 0] ** 2 + p[:, 1] ** 2) / (2.0 * RADIUS) + 1e-9)
    touch = Pair(faces_at(mesh, pulp), faces_at(mesh, ~of_tip & (np.abs(p[:, 2]) < 1e-9)), bound=2e-6)
    bed = ElasticFoundation(faces_at(mesh, p[:, 2] < 1e-9 - SLAB), BED * young)
    laws = {0: neo_hooke(young, POISSON), 1: neo_hooke(finger, POISSON)}
    down = np.outer(bone, (0.0, 0.0, -1.0))
    alone = ElasticBody(
        block, laws, [ElasticFoundation(faces_at(block, block.points[:, 2] < 1e-9 - SLAB), BED * young)]
    )
    print(f"  {p.size} unknowns")
    solver = Solver(mesh, laws, fixed, lambda load: load * down, contacts=[touch, bed], settings=STEPS)
    return run(solver, touch, lambda u: alone.balance(u[:count])[0])


def errors(name: str, found: np.ndarray, right: np.ndarray, unit: str = "force") -> None:
    off = 100.0 * (found / right - 1.0)
    print(f"{name}: {unit} error {math.sqrt(np.mean(off**2)):.1f} % RMS, {off[np.abs(off).argmax()]:+.1f} % at worst")


def force_error(name: str, approach: np.ndarray, forces: np.ndarray, right: np.ndarray) -> None:
    """Print the force error of a curve (approach [m], forces [N]) at the reference approaches [m] of `FORCES`."""
    errors(name, np.exp(np.interp(np.log(right), np.log(approach), np.log(forces))), FORCES)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--slab", type=float, default=60e3, help="modulus of the slab [Pa]")
    parser.add_argument("--finger", type=float, default=60e3, help="modulus of the pad [Pa]")
    parser.add_argument("--size", type=float, default=1.2e-3, help="elements under the contact [m], at most 2e-3")
    given = parser.parse_args()
    # rigid ball against Hertz: F = 4/3 E* sqrt(R) d^(3/2)
    plane_strain = YOUNG / (1.0 - POISSON**2)
    depths = np.linspace(5e-5, 5e-4, 40)
    forces = 4.0 / 3.0 * plane_strain * math.sqrt(RADIUS) * depths**1.5
    pressed = indentations(ball(RADIUS, plane_strain), YOUNG, forces)
    off = forces * (depths / pressed) ** 1.5 - forces
    error = 100.0 * math.sqrt(np.mean(off**2)) / forces[-1]
    print(f"rigid ball of {1e3 * RADIUS:g} mm on the slab, to 0.5 mm: force error {error:.1f} % of the peak (RMS)")
    print("fingertip on a rigid plate")
    plate = on_plate(given.finger, given.size)
    print("fingertip on the slab")
    full = on_slab(given.finger, given.slab, given.size)

    # curves at FORCES by log-log interpolation, without the first step, which is below them
    def at(forces: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.exp(np.interp(np.log(FORCES), np.log(forces[1:]), np.log(values[1:])))

    wide, compression = at(plate[1], plate[2]), at(plate[1], plate[0])
    law = of_table(FORCES, np.cbrt(wide**3 + 0.75 * FORCES * RADIUS * (1.0 - POISSON**2) / given.slab))
    # d = V/f + integral of (V/f) d(ln f), with V ~ f^(5/3) before the first step
    share = full[3, 1:] / full[1, 1:]
    steps = 0.5 * (share[1:] + share[:-1]) * np.diff(np.log(full[1, 1:]))
    indentation = np.append(0.0, share + 1.5 * share[0] + np.append(0.0, np.cumsum(steps)))
    s, e = at(full[1], indentation), at(full[1], full[0])
    errors("contact of the law", law.radii**2, at(full[1], full[2]) ** 2, "area")
    fine = np.geomspace(0.02, 4.0, 200)
    for name, area in (("growing contact", law), ("fixed patch of 8 mm", FIXED)):
        found = indentations(area, given.slab, fine)
        force_error(f"{name}, at the indentation of the slab", found, fine, s)
        compression_on_plate = np.exp(np.interp(np.log(fine), np.log(plate[1, 1:]), np.log(plate[0, 1:])))
        inside = fine <= plate[1, -1]
        force_error(f"{name}, at the approach of the bone", (found + compression_on_plate)[inside], fine[inside], e)
    for row in zip(FORCES[::5], 1e3 * s[::5], 1e3 * compression[::5], 1e3 * law.radii[::5], strict=True):
        print("  {:.3f} N: slab {:.2f} mm, pad on a plate {:.2f} mm, a of the law {:.2f} mm".format(*row))


if __name__ == "__main__":
    main()
