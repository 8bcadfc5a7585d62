"""How fast the force changes where a slide passes a gap of any shape: full finite elements of that very body.

    python benchmarks/moving_shape.py [SURFACE ...] [--vertices 1500] [--deep 9] [--speed 200]

As `moving_load.py`, for surfaces of the zoo of `palpate bench organs` that have a gap across y = 0 (groove-8, fissure),
and for bodies without one (block, unfissured). The finger slides as in `benchmarks/slides.py --body ReducedFE --exact`
at one speed [mm/s] and depth [mm], on linear tissue. The reference is the mesh of tetrahedra that the basis is made of,
with a surface of about VERTICES vertices, on the same foundation. Each tick's patch of `spread.Kernel` loads its faces
directly, without the coarse surface of the basis and without corrections. In each step

    e = s + d,    s(t) = integral of c(t, t') F(t') exp(-(t - t')/tau) dt'/tau

is solved for the force of the fingertip, with the approach e of the run and the compliance c(t, t') = p(t).C p(t')
between the patches p of two ticks, each with the forces along the surface that hold its mean place (the body sticks to
the finger). Printed are the largest change of the force in a tick within `NEAR` of the gap, and the forces.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from moving_load import FINGER, NEAR

from palpate.bases import build_missing
from palpate.models.build.basis import _organ, silent
from palpate.models.fe.reduce.reducible import Reducible, of_organ
from palpate.nodes.base.felt import bearing
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.spread import Kernel
from palpate.physics.bodies.patch import barycentric
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.contact.spread import spread, spreader
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.organs.gaps import MM
from palpate.studies.organs.runs import Traces, launch, run
from palpate.studies.organs.slides import slide_touch
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import on
from palpate.studies.organs.zoo import GAPPED, USUAL

ASIDE = 0.3 * MM  # [m] of the path from the plane of symmetry, as in `slides.py`
AFTER = 30  # ticks at rest after the slide
SHOWN = np.linspace(-6e-3, 6e-3, 13)  # [m]


class Slide(NamedTuple):
    """A run: place of the foot across the gap [m], approach [m] and force [N] in ticks, the first one at rest."""

    traces: Traces
    y: np.ndarray
    approach: np.ndarray
    force: np.ndarray
    ticks: np.ndarray


def slide(name: str, speed: float, deep: float, folder: Path) -> Slide:
    """A slide of ReducedFE with linear tissue in the graph."""
    setting = Setting("block", USUAL, "ReducedFE", friction="", width=16 * MM, exact=True)
    touch = on(slide_touch(setting, 1.0, speed, deep, ASIDE), name)
    extra = ["tissue.model=linear"]
    build_missing(launch(touch.setting, folder, touch.duration, extra).load(), False)
    traces = run([touch], folder, extra=extra)[0]
    if traces.failed:
        raise SystemExit(f"moving_shape: {name}: {traces.failed[0]}")
    press, hold, across, _ = touch.fingers[0].path
    begin, count = round((press["time"] + hold["hold"]) / traces.step), round(across["time"] / traces.step)
    ticks = np.arange(begin - 1, begin + count + AFTER)
    foot, s, d, f = (traces[f"contact.{each}"][0, ticks] for each in ("foot", "indentation", "compression", "force"))
    return Slide(traces, foot[:, 1], s + d, f, ticks)


def loads(moved: Slide, body: Reducible, node: ReducedFE) -> np.ndarray:
    """Forces per newton [1] (T,3,N,3) on the nodes of the elements: of the patch of each tick against its normal, and
    along two directions of the surface."""
    kernel = Kernel(**moved.traces.nodes["spread"])
    kernel.start()
    patch = spreader(kernel.mesh(), kernel.radius, kernel.kernel, bearing(kernel, kernel.width))
    faces, points = body.mesh.faces, body.mesh.points
    skin = Mesh(points, faces[:, :3].astype(np.int32))
    found = np.zeros((len(moved.ticks), 3, *points.shape))
    closest = MeshClosestPoint(skin)
    for k, tick in enumerate(moved.ticks):
        foot, normal = (moved.traces[f"contact.{each}"][0, tick] for each in ("foot", "normal"))
        count = spread(patch, tuple(foot), tuple(normal), tuple(-normal))
        at = patch.vertices[patch.nodes[:count]] - np.asarray(node.position)
        place, _, triangle, _ = closest.find_along(at)
        _, near = barycentric(skin, triangle, place)
        a, b, c = near.T
        shape = np.stack([a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * a * b, 4 * b * c, 4 * c * a], axis=1)
        share = (patch.weights[:count, None] * shape).ravel()
        axes = np.zeros((2, 3))
        sideways(tuple(normal), axes)
        total = np.bincount(faces[triangle].ravel(), share, minlength=len(points))
        for axis, way in enumerate((-normal, *axes)):
            found[k, axis] = total[:, None] * way
    return found


def compliances(moved: Slide, name: str, vertices: int) -> np.ndarray:
    """c(t, t') [m/N] (T,T) between the patches of the ticks, of full elements; their surface sticks to the finger."""
    node = ReducedFE(**moved.traces.nodes["tissue"])
    body = of_organ(_organ(node, silent, vertices))
    print(f"{name}: {len(body.surface.vertices)} vertices, {len(body.mesh.elements)} elements", flush=True)
    given = loads(moved, body, node)
    count = len(given)
    flat = given.reshape(count * 3, -1)
    tangent = body.elastic.rest(body.fixed)
    moves = tangent.solve(np.ascontiguousarray(flat.T)).T
    between = (flat @ moves.T).reshape(count, 3, count, 3) / node.young
    with_held = np.ones((count, 3))
    for k in range(count):
        block = between[k, :, k]
        with_held[k, 1:] = -np.linalg.solve(block[1:, 1:], block[1:, 0])
    return np.einsum("ia,iajb,jb->ij", with_held, between, with_held)


def forces(c: np.ndarray, approach: np.ndarray, tau: float, dt: float) -> np.ndarray:
    """F [N] (T) of a finger with an approach [m] (T) to the Kelvin-Voigt body, in backward Euler's steps. In the first
    tick both are at rest."""
    keep, take, found, before = tau / (dt + tau), dt / (dt + tau), np.zeros(len(c)), None
    b, m, c_1 = FINGER
    for n in range(len(c)):
        row = c[n, : n + 1] * take * keep ** np.arange(n, -1, -1)
        row[0] = c[n, 0] * keep**n  # all that was before is in the first
        left, low, high = approach[n] - row[:n] @ found[:n], 0.0, 20.0
        for _ in range(60):  # the force of the fingertip falls with F
            force = 0.5 * (low + high)
            d = left - row[n] * force
            rate = 0.0 if before is None else (d - before) / dt
            pull = b / m * np.expm1(m * min(max(d, 0.0), 8e-3)) * max(1.0 + c_1 * rate, 0.0)
            low, high = (force, high) if pull > force else (low, force)
        found[n], before = force, left - row[n] * force
    return found


def show(label: str, y: np.ndarray, force: np.ndarray) -> None:
    """Print the largest change of the force [N] (T) of a slide at the places y [m] (T), and forces."""
    near = np.flatnonzero(np.abs(y) < NEAR)
    change = np.diff(force)[near - 1]
    up, down = change.max(), -change.min()
    line = " ".join(f"{value:.2f}" for value in np.interp(SHOWN, y[near], force[near]))
    at = 1e3 * y[near][change.argmax()], 1e3 * y[near][change.argmin()]
    print(f"  {label:18} rises by at most {up:.4f} N in a tick (y = {at[0]:.1f} mm), falls by {down:.4f} N "
          f"({at[1]:.1f} mm)")  # fmt: skip
    print(f"  {'':18} [N] at y = -6, -5 ... 6 mm: {line}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", nargs="*", default=("groove-8", "block", "fissure", "unfissured"))
    parser.add_argument("--vertices", type=int, default=1500, help="of the surface of the elements")
    parser.add_argument("--deep", type=float, default=9.0, help="[mm] target of the hand below the top")
    parser.add_argument("--speed", type=float, default=200.0, help="[mm/s]")
    given = parser.parse_args()
    if unknown := [name for name in given.surfaces if name not in (*GAPPED, "block", "unfissured")]:
        parser.error(f"surface: found {unknown[0]!r}, expected one of block, unfissured, {', '.join(GAPPED)}")
    for name in given.surfaces:
        with tempfile.TemporaryDirectory() as folder:
            moved = slide(name, MM * given.speed, MM * given.deep, Path(folder))
            c = compliances(moved, name, given.vertices)
        tau = moved.traces.nodes["tissue"]["retardation"]
        at = [f"{1e3 * c[k, k]:.3f}" for k in (np.abs(moved.y - place).argmin() for place in (-8e-3, -3e-3, 0.0))]
        print(f"  compliance at y = -8, -3, 0 mm: {', '.join(at)} mm/N")
        show("elements", moved.y, forces(c, moved.approach, tau, moved.traces.step))
        show("elements, at rest", moved.y, forces(c, moved.approach, 0.0, moved.traces.step))
        show("ReducedFE", moved.y, moved.force)


if __name__ == "__main__":
    main()
