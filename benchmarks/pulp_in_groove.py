"""How far a soft fingertip sinks into a groove, and the width of the ball that sinks as far.

    python benchmarks/pulp_in_groove.py                    # grooves of 2 to 12 mm without a floor, and shallow floors
    python benchmarks/pulp_in_groove.py 8 12x1             # grooves of 8 mm, and of 12 mm with a floor 1 mm deep
    python benchmarks/pulp_in_groove.py --size 0.9e-3      # finer elements under the contact

The felt surface is what a rigid ball of the radius r = `finger.width`/2 touches (docs/your_organ.md): over a groove of
width w it sinks by r - sqrt(r² - w²/4). A fingertip is soft. Here the neo-Hookean paraboloid of `growing_contact.py`
(radius 8 mm, thickness 12 mm, bonded to its bone) is pressed without friction on a rigid plate and across grooves of a
rigid plate, whose rims are rounded by q = 0.5 mm. At equal force the approach over the groove less that on the plate is
the dip; a rigid ball on these rims has the dip r + q - sqrt((r + q)² - (w/2 + q)²), or that of the floor. Printed are
the dip, and that of the ball of 8 mm over it. Forces scale with the modulus of the pad.
"""

from __future__ import annotations

import argparse

import numba
import numpy as np
from growing_contact import FORCES, POISSON, RADIUS, STEPS, THICK, faces_at, pad, run

from palpate.models.fe import RigidIndenter, Solver
from palpate.physics.materials.neo_hooke import neo_hooke

RIM = 0.5e-3  # [m] radius of the rims
GROOVES = ("2", "4", "6", "8", "10", "12", "8x0.5", "8x1", "12x1", "12x2")  # [mm] width, and depth
DEEP = 1.0  # [m] a groove without a floor
SHOWN = (0.25, 0.5, 1.0, 2.0)  # [N]


@numba.njit(cache=True)
def groove(x, p, normal, curvature):
    """Half-space z < 0 with a groove along x of width p[0] and depth p[1]; its rims are rounded with radius p[2]."""
    half, depth, rim = 0.5 * p[0], p[1], p[2]
    side, a = (1.0 if x[1] >= 0.0 else -1.0), abs(x[1])
    normal[:], curvature[:] = 0.0, 0.0
    across, above = half + rim - a, x[2] + rim  # from the axis of the rim
    if across > 0.0 and above > 0.0:
        distance = max(np.sqrt(across * across + above * above), 1e-300)
        y, z = -side * across / distance, above / distance
        gap = distance - rim
        curvature[1, 1], curvature[1, 2] = z * z / distance, -y * z / distance
        curvature[2, 1], curvature[2, 2] = -y * z / distance, y * y / distance
        normal[1], normal[2] = y, z
    elif x[2] > half - a:
        gap = x[2]
        normal[2] = 1.0
    else:
        gap = half - a
        normal[1] = -side
    if a < half and x[2] + depth < gap:
        gap = x[2] + depth
        normal[1], normal[2] = 0.0, 1.0
        curvature[:] = 0.0
    return gap


def press(width: float, depth: float, given: argparse.Namespace) -> np.ndarray:
    """Approach [m] at `FORCES` of the pad on the plate with this groove; without one if the width is 0."""
    mesh = pad(given.size)
    p = mesh.points
    fixed = np.stack([p[:, 0] < 1e-9, p[:, 1] < 1e-9, np.zeros(len(p), bool)], axis=1) | (p[:, 2:] > THICK - 1e-9)
    below = faces_at(mesh, p[:, 2] < (p[:, 0] ** 2 + p[:, 1] ** 2) / (2.0 * RADIUS) + 1e-9)
    numbers = (width, depth, RIM) if width > 0.0 else (-1.0, DEEP, 1e-6)
    touch = RigidIndenter(below, groove, numbers, lambda load: np.array([0.0, 0.0, load]), bound=2e-6)
    solver = Solver(mesh, {0: neo_hooke(given.finger, POISSON)}, fixed, contacts=[touch], settings=STEPS)
    found = run(solver, touch)
    return np.interp(FORCES, found[1], found[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--finger", type=float, default=60e3, help="modulus of the pad [Pa]")
    parser.add_argument("--size", type=float, default=1.2e-3, help="elements under the contact [m], at most 2e-3")
    parser.add_argument("grooves", nargs="*", default=GROOVES, metavar="WIDTH[xDEPTH]", help="[mm]")
    given = parser.parse_args()
    print("plate")
    flat = press(0.0, DEEP, given)
    rows = []
    for name in given.grooves:
        print(f"groove {name} mm")
        width, _, depth = name.partition("x")
        half, floor = 0.5e-3 * float(width), 1e-3 * float(depth) if depth else DEEP
        dips = np.interp(SHOWN, FORCES, press(2.0 * half, floor, given) - flat)
        away = max((RADIUS + RIM) ** 2 - (half + RIM) ** 2, 0.0)
        rows.append((name, dips, min(RADIUS + RIM - np.sqrt(away), floor)))
    print("\n groove [mm]  dip [mm] at " + ", ".join(f"{f:g} N" for f in SHOWN) + "; ball of 8 mm; over the dip")
    for name, dips, ball in rows:
        print(f"{name:>12}  ", *(f"{1e3 * dip:6.3f}" for dip in dips), f"  {1e3 * ball:6.3f}",
              "  ", *(f"{ball / dip:5.2f}" for dip in dips))  # fmt: skip


if __name__ == "__main__":
    main()
