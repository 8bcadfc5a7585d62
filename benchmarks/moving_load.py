"""How fast the force rises where a load passes a gap: full finite elements against deformation.ReducedFE.

    python benchmarks/moving_load.py [GAP ...] [--size 1.2e-3] [--rate 1000]

A finger slides at 200 mm/s across the gap [mm] of the block of `palpate bench organs` that is cut in two, in the graph
kidney with linear tissue and a stiff hand. The reference is half of the block, bonded below, with linear elements
(`fe`): its compliance c(y, y') between biweight loads on its top at y and y' [m/N], and that of both halves is their
sum. Walls of a gap below 1 mm push each other: loads on both halves in the same sense leave them in place. A
Kelvin-Voigt body and the fingertip share the approach e of the run at the place y,

    e = s + d,    s(t) = integral of c(y(t), y(t')) F(t') exp(-(t - t')/tau) dt'/tau,
    F = b/m (exp(m d) - 1) <1 + c_1 d'>,

solved for the force F in the steps of the run. Printed are the forces on the way, and the greatest rise of the force in
a step; and those of the body at rest, tau = 0. The surface slides freely under the finger (`tissue.sticks: false`), and
at last sticks to it, as it does by default: then each F acts with the force along the surface that holds the mean of
the patch at its place, and stays in the history with it, so that c(y, y') is that between the loads with this force.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from growing_contact import POISSON, RADIUS, WIDE, faces_at
from pad_on_groove import COARSEST, FINEST, GROUND, PLACE, YOUNG
from scipy.interpolate import RectBivariateSpline

from palpate.bases import build_missing
from palpate.models.fe import TetMesh, quadratic
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import bricks, grid
from palpate.models.fe.solve.body import ElasticBody
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.organs import gaps
from palpate.studies.organs.runs import launch, run
from palpate.studies.organs.slides import FAR, slide_touch
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import on
from palpate.studies.organs.zoo import USUAL
from palpate.studies.peers.continuum import grade_axis

FINGER = 26.2641, 1681.06, 8.0  # [N/m], [1/m], [s/m] b, m and c_1 of contact.Series
HAND = "device.hand_stiffness=2e4"  # [N/m] so that the approach hardly depends on the force
SPEED, DEEP = 0.2, 4e-3  # [m/s], [m]
PLACES = np.linspace(-FAR - 1e-3, FAR + 1e-3, 41)  # [m] of the loads
SHOWN = np.linspace(-6e-3, 6e-3, 13)  # [m]
WALLS = 1e-3  # [m] `tissue.walls`: walls of a narrower gap push each other
NEAR = 6.5e-3  # [m] from the middle: beyond, the slide begins and ends


def compliances(gap: float, size: float) -> tuple[np.ndarray, np.ndarray]:
    """c(y, y') [m/N] between loads at `PLACES`, of the block with a gap [m], whose surface slides freely under them,
    and whose surface sticks; 0: the whole block."""
    half = 0.5 * gap
    begin = half if gap else -0.5 * gaps.WIDE
    fine = half if gap else -FAR - WIDE
    x = grade_axis(0.0, 0.0, WIDE, 0.5 * gaps.LONG, size)
    y = grade_axis(begin, fine, FAR + WIDE, 0.5 * gaps.WIDE, size)
    z = grade_axis(-gaps.HIGH, -4.0 * size, 0.0, 0.0, size)
    points, cells = grid(x, y, z)
    mesh = quadratic(points, bricks(points, cells))
    p = mesh.points
    fixed = np.stack([p[:, 0] < 1e-9, np.zeros(len(p), bool), np.zeros(len(p), bool)], axis=1)
    fixed |= (p[:, 2] < 1e-9 - gaps.HIGH)[:, None]
    top = faces_at(mesh, np.abs(p[:, 2]) < 1e-9)
    at = np.einsum("qa,fak->fqk", face_rule.VALUES, p[top])[..., :2]
    areas = face_rule.areas(p, top)
    loads = []
    for axis in (2, 1):
        for place in PLACES:
            near = np.maximum(1.0 - (at[..., 0] ** 2 + (at[..., 1] - place) ** 2) / RADIUS**2, 0.0) ** 2
            load = np.zeros_like(p)
            np.add.at(load[:, axis], top, -np.einsum("fq,qa->fa", near * areas, face_rule.VALUES))
            loads.append(load)
    total = np.array([2.0 * np.abs(load.sum()) for load in loads[: len(PLACES)]])  # of both halves along x
    one = _between(mesh, loads, fixed)
    if gap:  # the other piece is the mirror image: loads on both in the same sense, and in opposite ones
        total = total + total[::-1]
        meet = fixed.copy()
        meet[:, 1] |= (p[:, 1] < half + 1e-9) & (gap < WALLS)  # in the same sense walls that push each other stay
        same = _between(mesh, loads, meet) if gap < WALLS else one
        one = 0.5 * (_on_both(same, 1.0) + _on_both(one, -1.0))
    one /= total[:, None, None] * total
    side = -np.diag(one[1, :, 0]) / np.diag(one[1, :, 1])
    to, across = side[:, None] * one[1, :, 0], side[:, None] * one[1, :, 1] * side
    return one[0, :, 0], one[0, :, 0] + to + one[0, :, 1] * side + across


def _between(mesh: TetMesh, loads: list[np.ndarray], fixed: np.ndarray) -> np.ndarray:
    """Work [N² m/N] (2,P,2,P) of loads along two axes at `PLACES` on the displacements by each other."""
    tangent = ElasticBody(mesh, {0: neo_hooke(YOUNG, POISSON)}, []).rest(fixed)
    moved = [tangent.solve(load) if load.any() else np.zeros_like(load) for load in loads]
    return 2.0 * np.einsum("inc,jnc->ij", np.array(loads), np.array(moved)).reshape(2, len(PLACES), 2, len(PLACES))


def _on_both(work: np.ndarray, sense: float) -> np.ndarray:
    """The work (2,P,2,P) of loads with their mirror images times a sense, on each other."""
    sign = sense * np.array([1.0, -1.0])[:, None]
    work = work + sign[..., None, None] * work[:, ::-1]
    return work + sign * work[..., ::-1]


def forces(c: RectBivariateSpline, y: np.ndarray, approach: np.ndarray, tau: float, dt: float) -> np.ndarray:
    """F [N] (n) of a finger with an approach [m] (n) to the Kelvin-Voigt body at the places y [m] (n), in backward
    Euler's steps."""
    keep, take, found, before = tau / (dt + tau), dt / (dt + tau), np.zeros(len(y)), 0.0
    for n in range(len(y)):
        row = c(y[n], y[: n + 1], grid=False) * take * keep ** np.arange(n, -1, -1)
        left, low, high = approach[n] - row[:n] @ found[:n], 0.0, 20.0
        for _ in range(50):  # the force of the fingertip falls with F
            force = 0.5 * (low + high)
            d = left - row[n] * force
            pull = (
                FINGER[0]
                / FINGER[1]
                * np.expm1(FINGER[1] * max(d, 0.0))
                * max(1.0 + FINGER[2] * (d - before) / dt, 0.0)
            )
            low, high = (force, high) if pull > force else (low, force)
        found[n], before = force, left - row[n] * force
    return found


def product(name: str, rate: float, sticks: bool, folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Place across the gap [m], approach [m] and force [N] of a slide in the graph, and tau [s]."""
    setting = Setting("block", USUAL, "ReducedFE", friction="", rate=rate, width=2.0 * RADIUS, exact=True)
    touch = on(slide_touch(setting, 1.0, SPEED, DEEP, PLACE), name)
    tissue = {"young": YOUNG, "poisson": POISSON, "bed": GROUND, "model": "linear", "sticks": str(sticks).lower()}
    extra = [*(f"tissue.{key}={value}" for key, value in tissue.items()), HAND]
    build_missing(launch(touch.setting, folder, touch.duration, extra).load(), False)
    traces = run([touch], folder, extra=extra)[0]
    if traces.failed:
        raise SystemExit(f"moving_load: {name}: {traces.failed[0]}")
    last = traces.ticks[0]
    y, s, d, f = (traces[f"contact.{each}"][0, :last] for each in ("foot", "indentation", "compression", "force"))
    law = traces.nodes["contact"]
    if (found := tuple(law[f"finger_{name}"] for name in ("stiffness", "hardening", "damping"))) != FINGER:
        raise SystemExit(f"moving_load: found the fingertip {found}, expected {FINGER}")
    return y[:, 1], s + d, f, traces.nodes["tissue"]["retardation"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gaps", nargs="*", type=float, default=(0.0, 2.0), metavar="GAP", help="[mm]; 0: no gap")
    parser.add_argument("--size", type=float, default=1.2e-3, help="elements under the loads [m]")
    parser.add_argument("--rate", type=float, default=1000.0, help="[Hz] of the run")
    given = parser.parse_args()
    if unknown := [gap for gap in given.gaps if gap and gap not in gaps.GAPS]:
        parser.error(f"gap: found {unknown[0]:g}, expected 0 or one of {', '.join(f'{g:g}' for g in gaps.GAPS)}")
    if not FINEST <= given.size <= COARSEST:
        parser.error(f"--size: found {given.size:g} m, expected {FINEST:g} to {COARSEST:g} m")
    if not 100.0 <= given.rate <= 20_000.0:
        parser.error(f"--rate: found {given.rate:g} Hz, expected 100 to 20000")
    for gap in given.gaps:
        with tempfile.TemporaryDirectory() as folder:
            name = f"cut-{gap:g}" if gap else "block"
            y, approach, free, tau = product(name, given.rate, False, Path(folder))
            held_y, held_approach, held, _ = product(name, given.rate, True, Path(folder))
        c, sticks = (RectBivariateSpline(PLACES, PLACES, each) for each in compliances(1e-3 * gap, given.size))
        viscous, rest = (forces(c, y, approach, each, 1.0 / given.rate) for each in (tau, 0.0))
        sticking = forces(sticks, held_y, held_approach, tau, 1.0 / given.rate)
        at = " ".join(f"{1e3 * c(place, place)[0, 0]:.3f}" for place in (0.0, 3e-3, 8e-3))
        print(f"gap {gap:g} mm: compliance of the elements at 0, 3, 8 mm {at} mm/N")
        show("elements", y, viscous)
        show("elements, at rest", y, rest)
        show("ReducedFE", y, free)
        show("elements, stick", held_y, sticking)
        show("ReducedFE, sticks", held_y, held)


def show(label: str, y: np.ndarray, force: np.ndarray) -> None:
    """Print the forces [N] (n) of a slide at the places y [m] (n), and their greatest rise."""
    there = np.flatnonzero(np.abs(y) < NEAR)
    rises = np.diff(force)[there - 1]
    line = " ".join(f"{value:.2f}" for value in np.interp(SHOWN, y[there], force[there]))
    place = 1e3 * y[there][rises.argmax()]
    print(f"  {label:18} rises by at most {rises.max():.4f} N in a tick, at y = {place:.2f} mm")
    print(f"  {'':18} [N] at y = -6, -5 ... 6 mm: {line}", flush=True)


if __name__ == "__main__":
    main()
