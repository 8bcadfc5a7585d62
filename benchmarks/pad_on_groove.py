"""Stiffness of a grooved block under a soft fingertip, from full finite elements, and that of deformation.ReducedFE.

    python benchmarks/pad_on_groove.py [WIDTH ...] [--finger 60e3] [--size 1.6e-3]

The block of the zoo of `palpate bench organs` (40 x 60 x 24 mm, bonded below), with a groove 10 mm deep and WIDTH mm
wide through its middle, is pressed there by the neo-Hookean pad of `growing_contact.py` without friction (`fe.Pair`, on
top and walls of the groove). The indentation of the block is the integral of dV/f over its energy V, so that the dip of
the pad is not in it. Printed is the stiffness f/s over that of the block without the groove, at `SHOWN` forces, for the
elements, and for ReducedFE in presses of the graph kidney with the same modulus. Rims are sharp: over one of 4 mm
the elements do not converge beyond 0.3 N. A run takes 10 to 20 min.

    python benchmarks/pad_on_groove.py 2 4 8 --same-load    # 1 min

prints the stiffness of linear elements under the pressure that ReducedFE bears, and that of ReducedFE, linear as well.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import scipy
from growing_contact import POISSON, RADIUS, STEPS, THICK, WIDE, faces_at, pad, run, with_pad

from palpate.bases import build_missing
from palpate.models.fe import Pair, Solver, quadratic
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import TetMesh, bricks, grid
from palpate.models.fe.solve.body import ElasticBody
from palpate.nodes.base.felt import bearing
from palpate.nodes.spread import Kernel
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.organs import gaps
from palpate.studies.organs.runs import Traces, launch
from palpate.studies.organs.runs import run as run_touches
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import on, press_touch
from palpate.studies.organs.zoo import USUAL
from palpate.studies.peers.continuum import grade_axis

SHOWN = (0.25, 0.5, 1.0)  # [N]
GROUND = 1e4  # [1/m] foundation of ReducedFE, stiff
DEPTHS = np.linspace(1e-3, 16e-3, 31)  # [m] of the presses of the graph
FINEST, COARSEST = 0.5e-3, 2e-3  # [m] elements under the contact
PLACE = 0.3e-3  # [m] x of the presses, off the plane of symmetry
YOUNG, LEAST = 60e3, 0.01  # [Pa], [N] of the first step that counts


def quarter(half: float, size: float) -> TetMesh:
    """A quarter of the block, its top at z = 0, with half of a groove of 2 `half` [m]; 0: none."""
    x = grade_axis(0.0, 0.0, WIDE, 0.5 * gaps.LONG, size)
    y = grade_axis(half, half, max(WIDE, half + size), 0.5 * gaps.WIDE, size)
    if half > 0.0:
        y = np.concatenate([np.linspace(0.0, half, 1 + max(1, round(half / size)))[:-1], y])
    z = grade_axis(-gaps.HIGH, -4.0 * size, 0.0, 0.0, size)
    z[np.abs(z + gaps.DEEP).argmin()] = -gaps.DEEP
    points, cells = grid(x, y, z)
    middle = points[cells].mean(axis=1)
    cells = cells[(middle[:, 1] > half) | (middle[:, 2] < -gaps.DEEP)]
    used, cells = np.unique(cells, return_inverse=True)
    points = points[used]
    cells = cells.reshape(-1, 8)
    return quadratic(points, bricks(points, cells))


def full(half: float, finger: float, size: float) -> np.ndarray:
    """Force over indentation [N/m] of the block under the pad at `SHOWN` forces."""
    tip, block = pad(size), quarter(half, size)
    count = len(block.points)
    mesh = with_pad(block, tip)
    p, of_tip = mesh.points, np.arange(len(mesh.points)) >= count
    bone, ground = of_tip & (p[:, 2] > THICK - 1e-9), ~of_tip & (p[:, 2] < 1e-9 - gaps.HIGH)
    fixed = np.stack([p[:, 0] < 1e-9, p[:, 1] < 1e-9, np.zeros(len(p), bool)], axis=1) | (bone | ground)[:, None]
    pulp = of_tip & (p[:, 2] < (p[:, 0] ** 2 + p[:, 1] ** 2) / (2.0 * RADIUS) + 1e-9)
    wall = (np.abs(p[:, 1] - half) < 1e-9) & (p[:, 2] > -gaps.DEEP - 1e-9) if half > 0.0 else np.zeros(len(p), bool)
    master = np.concatenate([faces_at(mesh, ~of_tip & flags) for flags in (np.abs(p[:, 2]) < 1e-9, wall)])
    touch = Pair(faces_at(mesh, pulp), master, bound=2e-6)
    laws = {0: neo_hooke(YOUNG, POISSON), 1: neo_hooke(finger, POISSON)}
    alone = ElasticBody(block, laws, [])
    solver = Solver(mesh, laws, fixed, lambda load: load * np.outer(bone, (0.0, 0.0, -1.0)), contacts=[touch],
                    settings=STEPS)  # fmt: skip
    _, force, _, energy = run(solver, touch, lambda u: alone.balance(u[:count])[0], SHOWN[-1])
    force, energy = force[force > LEAST], energy[force > LEAST]  # the pad begins above the rims
    # d = V/f + integral of (V/f) d(ln f), with V ~ f^(5/3) before the first step
    share = energy / force
    steps = 0.5 * (share[1:] + share[:-1]) * np.diff(np.log(force))
    indentation = share + 1.5 * share[0] + np.append(0.0, np.cumsum(steps))
    return np.array(SHOWN) / np.exp(np.interp(np.log(SHOWN), np.log(force), np.log(indentation)))


def presses(surface: str, folder: Path, depths: np.ndarray, *more: str) -> tuple[Traces, int]:
    """Presses of ReducedFE in the graph to these depths [m], and the number of a tick at their end."""
    setting = Setting("block", USUAL, "ReducedFE", friction="", width=2.0 * RADIUS)
    place, down = np.array([PLACE, 0.0, 0.5 * gaps.HIGH]), np.array([0.0, 0.0, -1.0])
    touches = [on(press_touch(setting, place, down, float(deep)), surface) for deep in depths]
    extra = [f"tissue.young={YOUNG:g}", f"tissue.poisson={POISSON:g}", f"tissue.bed={GROUND:g}", *more]
    build_missing(launch(touches[0].setting, folder, touches[0].duration, extra).load(), False)
    traces = run_touches(touches, folder, extra=extra)[0]
    if traces.failed:
        raise SystemExit(f"pad_on_groove: {surface}: {next(iter(traces.failed.values()))}")
    return traces, round((touches[0].duration - 0.15) / traces.step)


def same_load(surface: str, half: float, size: float, folder: Path) -> tuple[float, float]:
    """Force over indentation [N/m] of linear elements under the pressure of a light press, and of ReducedFE."""
    traces, last = presses(surface, folder, np.array([4e-3]), "tissue.model=linear")
    foot, normal = (tuple(traces[f"contact.{name}"][0, last]) for name in ("foot", "normal"))
    node = Kernel(**traces.nodes["spread"])
    node.start()
    mesh, part = node.mesh(), bearing(node, node.width)
    patch = spreader(mesh, node.radius, node.kernel, part)
    count = spread(patch, foot, normal, (0.0, 0.0, -1.0))
    nodes = patch.nodes[:count]
    pressure = patch.weights[:count] / (mesh.areas if part is None else part.areas)[nodes]
    at = mesh.vertices[nodes, :2] - (foot[0], 0.0)
    block = quarter(half, size)
    p = block.points
    fixed = np.stack([p[:, 0] < 1e-9, p[:, 1] < 1e-9, np.zeros(len(p), bool)], axis=1)
    fixed |= (p[:, 2] < 1e-9 - gaps.HIGH)[:, None]
    top = faces_at(block, np.abs(p[:, 2]) < 1e-9)
    points = np.einsum("qa,fak->fqk", face_rule.VALUES, p[top])[..., :2]
    value = np.zeros(points.shape[:2])
    for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):  # a quarter bears the mean of the four
        there = y * at[:, 1] >= half - 1e-4 if half > 0.0 else np.ones(count, bool)
        value += 0.25 * scipy.interpolate.LinearNDInterpolator(at[there] * (x, y), pressure[there], 0.0)(points)
    load = np.zeros_like(p)
    np.add.at(load[:, 2], top, -np.einsum("fq,qa->fa", value * face_rule.areas(p, top), face_rule.VALUES))
    load /= 4.0 * np.abs(load.sum())
    body = ElasticBody(block, {0: neo_hooke(YOUNG, POISSON)}, [])
    elements = 1.0 / (4.0 * float(np.sum(load * body.rest(fixed).solve(load))))
    return elements, float(traces["contact.force"][0, last] / traces["contact.indentation"][0, last])


def reduced(surface: str, folder: Path) -> np.ndarray:
    """Force over indentation [N/m] of ReducedFE in presses of the graph at `SHOWN` forces."""
    traces, last = presses(surface, folder, DEPTHS)
    force, indentation = traces["contact.force"][:, last], traces["contact.indentation"][:, last]
    force, indentation = force[force > LEAST], indentation[force > LEAST]
    return np.array(SHOWN) / np.exp(np.interp(np.log(SHOWN), np.log(force), np.log(indentation)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("widths", nargs="*", type=float, default=(8.0,), metavar="WIDTH", help="[mm]")
    parser.add_argument("--finger", type=float, default=60e3, help="modulus of the pad [Pa]")
    parser.add_argument("--size", type=float, default=1.6e-3, help="elements under the contact [m], at most 2e-3")
    parser.add_argument("--same-load", action="store_true", help="linear elements under the pressure of ReducedFE")
    given = parser.parse_args()
    if unknown := [width for width in given.widths if width not in gaps.GROOVES]:
        parser.error(f"width: found {unknown[0]:g}, expected one of {', '.join(f'{w:g}' for w in gaps.GROOVES)}")
    if not FINEST <= given.size <= COARSEST:
        parser.error(f"--size: found {given.size:g} m, expected {FINEST:g} to {COARSEST:g} m")
    if not given.finger > 0.0:
        parser.error(f"--finger: found {given.finger:g} Pa, expected more than 0")
    rows = {}
    with tempfile.TemporaryDirectory() as name:
        for width in (0.0, *given.widths):
            print(f"groove {width:g} mm", flush=True)
            surface = f"groove-{width:g}" if width else "block"
            if given.same_load:
                elements, found = same_load(surface, 0.5e-3 * width, given.size, Path(name))
                print(f"  {elements:.0f} N/m with elements, {found:.0f} N/m with ReducedFE", flush=True)
                continue
            rows[width] = reduced(surface, Path(name)), full(0.5e-3 * width, given.finger, given.size)
            print("  stiffness [N/m]: ReducedFE", *np.round(rows[width][0]), "elements", *np.round(rows[width][1]))
    if given.same_load:
        return
    print("stiffness over that without a groove, at " + ", ".join(f"{f:g}" for f in SHOWN) + " N")
    for width in given.widths:
        for kind, which in (("elements", 1), ("ReducedFE", 0)):
            ratio = rows[width][which] / rows[0.0][which]
            print(f"groove {width:4g} mm  {kind:10}" + "".join(f"{x:6.2f}" for x in ratio))


if __name__ == "__main__":
    main()
