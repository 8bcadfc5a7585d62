"""Error and time of a sampled body against its number of modes and the tolerance of its elements.

    python docs/studies/sampled_modes.py fingertip [--modes 40 64 80] [--sampling 1e-2 5e-3 3e-3]
    python docs/studies/sampled_modes.py kidney [--modes 10 20 40 80 160] [--sampling 3e-3] [--touches 60]
    python docs/studies/sampled_modes.py slab [--modes 24 40 80] [--sampling 3e-2 1e-2 3e-3] [--touches 42]

Errors on ten touches that the basis was not made from, at their greatest load and over all loads; a step's time while a
finger presses and slides at 1 kHz. The fingertip: force of another fingertip in series, too, as in `sampled_fe.py`. The
kidney, coarse (200 vertices), and the slab of the tests: beside the linear body. `--keep` stores the
full solutions of an organ in a file, or takes them from it; those of the fingertip are where `palpate reduce` keeps
them.
"""

from __future__ import annotations

import argparse
import os
import pickle
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import beside  # noqa: F401
import numpy as np
from sampled_fe import Row, errors, times
from tables import show

from palpate.models.fe.meshing.fingertip import Fingertip
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.holdout import settled
from palpate.models.fe.reduce.reducible import Reducible, of_finger, of_organ
from palpate.models.fe.reduce.reduction import (
    CELLS,
    ORGAN_RADIUS,
    finger_pressed,
    finger_touches,
    in_modes,
    organ_touches,
    sampled,
)
from palpate.models.fe.reduce.snapshots import MILD, Pressed, Touch, press, press_from_rest, scatter
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import touches
from palpate.physics.bodies.condensed_body import Basis, CondensedBody
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody
from palpate.physics.contact.spread import Spreader
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

UNSEEN, SEED = 10, 77
YOUNG = 19e3


def kept(file: Path | None, solve) -> tuple[list[Pressed], list[Pressed]]:
    """Solutions of the touches that were seen and of those that were not."""
    if file is not None and file.exists():
        return pickle.loads(file.read_bytes())
    solutions = solve()
    if file is not None:
        file.write_bytes(pickle.dumps(solutions))
    return solutions


def fingertip(given: argparse.Namespace) -> None:
    full = of_finger(Fingertip(cells=CELLS))
    seen, held = finger_pressed(full, folder=touches())
    unseen = press(full, finger_touches(full, UNSEEN, SEED), folder=touches())
    rows: list[Row] = []
    for count in given.modes:
        whole = in_modes(full, seen, count)
        for tolerance in given.sampling:
            basis = sampled(full, held, whole, tolerance)
            missed = errors(full, unseen, basis)
            node = ReducedFE(surface="fingertip", model="sampled", modes=count, young=160.0, radius=5e-3, reach=12e-3)
            node.basis = lambda basis=basis: basis  # type: ignore[method-assign]
            node.start()
            (timed,) = times(node, np.nan)
            rows.append(
                {
                    "touches": len(seen) // 2,
                    "modes": count,
                    "sampling": tolerance,
                    "points": len(basis.points.kinds),
                    **{f"{name} {row['share of load']:g}": row[name] for row in missed[-2:] for name in list(row)[3:]},
                    "p50 us": timed["of the core's time p50 us"],
                    "p99 us": timed["p99 us"],
                }
            )
            print(" | ".join(f"{x:.3g}" for x in rows[-1].values()), flush=True)
    show("error against the number of modes", rows)


def indented(body: SampledBody | CondensedBody, own: Pressed, force: float) -> float:
    """Indentation under a force that is held."""
    nodes = np.flatnonzero(np.abs(own.touch.load).max(axis=1) > 0).astype(np.int32)
    if isinstance(body, SampledBody):
        return settled(body, own, nodes, force)[3]
    push, foot, normal = own.touch.load[nodes], tuple(own.touch.foot), tuple(own.touch.normal)
    return body.step(nodes, force * push, foot, normal, 1e6)[2]


def row(full: Reducible, fine: Mesh, unseen: list[Pressed], basis: Basis | SampledBasis) -> Row:
    """Errors of the indentation, and a step's time on a fine surface."""
    kind = SampledBody if isinstance(basis, SampledBasis) else CondensedBody
    missed: list[list[float]] = []
    for own in unseen:
        body, mine = kind(basis, full.surface, YOUNG, 0.0, ORGAN_RADIUS, 1.0), []
        for level, u in zip(own.touch.levels, own.solutions, strict=False):
            deep = float(np.sum((full.hats @ own.touch.load) * u))
            mine.append(abs(indented(body, own, float(level) * YOUNG) / deep - 1.0))
        missed.append(mine)
    last, every = [m[-1] for m in missed], np.concatenate(missed)
    spent = slid(kind(basis, fine, YOUNG, 0.02, ORGAN_RADIUS, 20e-3))
    return {
        "greatest load mean %": 1e2 * float(np.mean(last)),
        "worst %": 1e2 * float(np.max(last)),
        "all loads mean %": 1e2 * float(np.mean(every)),
        "p50 us": 1e6 * float(np.percentile(spent, 50)),
        "p99 us": 1e6 * float(np.percentile(spent, 99)),
    }


def slid(body: SampledBody | CondensedBody) -> list[float]:
    """The core's time of steps, pressing to 0.8 N in 0.3 s and sliding over the top at 20 mm/s."""
    spread, find = Spreader(body.mesh, ORGAN_RADIUS, "biweight"), MeshClosestPoint(body.mesh).find
    top, spent = float(body.mesh.vertices[:, 2].max()), []
    for k in range(1500):
        foot, _, triangle, _ = find(np.array([[np.interp(k, [300, 1500], [-0.012, 0.012]), 0.0, 1.5 * top]]))
        place = tuple(foot[0].tolist())
        face = body.mesh.face_vectors[triangle[0]]
        normal = tuple((face / np.linalg.norm(face)).tolist())
        force = 0.8 * min(k / 300.0, 1.0)
        count = spread.spread(place, normal, tuple(-force * n for n in normal)) if force > 0 else 0
        nodes, forces = spread.nodes[:count].copy(), spread.forces[:count].copy()
        begun = time.thread_time()
        body.step(nodes, forces, place, normal, 1e-3)
        spent.append(time.thread_time() - begun)
    return spent


def on_slab(body: Reducible, count: int, seed: int = 3) -> list[Touch]:
    """Touches of the middle of the slab."""
    middle = body.surface.vertices[body.surface.triangles].mean(axis=1)
    return scatter(body.surface, count, np.abs(middle).max(axis=1) < 0.026, 12e-3, 1.5 * 12e-3**2 * MILD, seed)


def organ(given: argparse.Namespace) -> None:
    slab = given.body == "slab"
    name, coarse = ("plane", 80) if slab else ("kidney", 200)
    shape, fine = Organ(surface_mesh(name, coarse)), surface_mesh(name, 3000)
    spots = on_slab if slab else organ_touches
    full = of_organ(shape)
    print(f"{3 * len(full.mesh.points)} degrees of freedom, {len(full.mesh.elements)} elements", flush=True)
    begun = time.perf_counter()
    seen, unseen = kept(
        given.keep,
        lambda: (
            press_from_rest(full, spots(full, given.touches)),
            press_from_rest(full, spots(full, UNSEEN, SEED)),
        ),
    )
    seen, unseen = ([p for p in presses if len(p.solutions)] for presses in (seen[: given.touches], unseen))
    for name, presses in (("seen", seen), ("unseen", unseen)):
        print(f"{name}: {sum(len(p.solutions) for p in presses)} solutions of {len(presses)} touches")
    print(f"{time.perf_counter() - begun:.0f} s", flush=True)
    surface, compliance = full.surface, full.compliance().astype(np.float32)
    nothing = np.zeros((len(surface.vertices), 0))
    rows: list[Row] = []
    linear = Basis(surface.vertices, surface.triangles, compliance, nothing)
    rows.append({"body": "linear", "points": 0, **row(full, fine, unseen, linear)})
    print(rows[-1], flush=True)
    for count in given.modes:
        whole = in_modes(full, seen[UNSEEN:], count)
        for tolerance in given.sampling:
            own = sampled(full, seen[:UNSEEN], whole, tolerance)
            name = f"{count} modes, {tolerance:g}"
            rows.append({"body": name, "points": len(own.points.kinds), **row(full, fine, unseen, own)})
            print(rows[-1], flush=True)
    show(f"{given.body}, error against the number of modes", rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("body", choices=("fingertip", "kidney", "slab"))
    parser.add_argument("--modes", type=int, nargs="+")
    parser.add_argument("--sampling", type=float, nargs="+")
    parser.add_argument("--touches", type=int)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    usual = {
        "fingertip": ([40, 64, 80], [1e-2, 5e-3, 3e-3], 0),
        "kidney": ([10, 20, 40, 80, 160], [3e-3], 60),
        "slab": ([24, 40, 80], [3e-2, 1e-2, 3e-3], 42),
    }
    modes, sampling, touches = usual[given.body]
    given.modes, given.sampling = given.modes or modes, given.sampling or sampling
    given.touches = given.touches or touches
    (fingertip if given.body == "fingertip" else organ)(given)


if __name__ == "__main__":
    main()
