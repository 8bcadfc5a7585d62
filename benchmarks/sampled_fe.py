"""Error and speed of the sampled fingertip compared with its full model, on touches outside its training set.

    python benchmarks/sampled_fe.py [--touches 6] [--modes 80] [--json]

The touches are patch loads of 3 to 6 mm, some with a tangential part, up to about 2 mm deep. For each share of the
greatest load: error of the indentation, and error of the force at a given approach with the default fingertip of
contact.Series in series. Also the size of the basis, and the time of a step at 1 kHz while the load presses, holds and
slides, compared with a load step of the full model. Takes several minutes on one core, mostly for the full model.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from tables import parser, print_tables

from palpate.messages import Load
from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.reduce.reducible import SUBCUTIS_MODULUS, Reducible, of_finger
from palpate.models.fe.reduce.reduction import CELLS, equilibrium, finger_touches
from palpate.models.fe.reduce.snapshots import STIFFENING, PressSolution, press_touches
from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.sampled_body import SampledBasis, sampled_body
from palpate.physics.contact.series import exponential
from palpate.physics.contact.spread import spread, spreader

YOUNG = SUBCUTIS_MODULUS / 36.4
Row = dict[str, object]


def errors(full: Reducible, presses: list[PressSolution], basis: SampledBasis) -> list[Row]:
    """Errors of the indentation at the same load, and of the force at the same approach with a finger in series."""
    finger = exponential(Series().finger_stiffness, Series().finger_hardening)
    missed: list[list[float]] = [[] for _ in STIFFENING]
    forces: list[list[float]] = [[] for _ in STIFFENING]
    depths: list[list[float]] = [[] for _ in STIFFENING]
    for pressed in presses:
        body = sampled_body(basis, full.surface, YOUNG, 0.0, 5e-3, 1.0)
        nodes = np.flatnonzero(np.abs(pressed.touch.load).max(axis=1) > 0).astype(np.int32)
        along = -(pressed.touch.load @ pressed.touch.normal)
        levels = pressed.touch.levels[: len(pressed.solutions)] * YOUNG
        means = np.einsum("nv,lni->lvi", full.hats, pressed.solutions)
        deep = np.array([float(-along @ (u @ pressed.touch.normal)) for u in means])
        for k, level in enumerate(levels):
            missed[k].append(abs(equilibrium(body, pressed, nodes, float(level)) / deep[k] - 1.0))
            depths[k].append(deep[k])
            approach = deep[k] + np.log1p(level * finger.second / finger.first) / finger.second
            low, high = 0.0, 4.0 * float(level)
            for _ in range(40):  # bisection: the force with this approach of finger and body together
                force = 0.5 * (low + high)
                compression = np.log1p(force * finger.second / finger.first) / finger.second
                further = equilibrium(body, pressed, nodes, force) + compression > approach
                low, high = (low, force) if further else (force, high)
            forces[k].append(abs(force / level - 1.0))
    return [
        {
            "share of load": float(STIFFENING[k]),
            "touches": len(missed[k]),
            "depth mm": 1e3 * float(np.mean(depths[k])),
            "indentation mean %": 1e2 * float(np.mean(missed[k])),
            "worst %": 1e2 * float(np.max(missed[k])),
            "force in series mean %": 1e2 * float(np.mean(forces[k])),
            "worst % ": 1e2 * float(np.max(forces[k])),
        }
        for k in range(len(STIFFENING))
        if missed[k]
    ]


def pressed_and_slid(t: float) -> tuple[float, float]:
    """Force [N] and position along the finger [m]: press to 0.5 N in 0.3 s, hold, slide at 20 mm/s, release."""
    force = float(np.interp(t, [0, 0.3, 2.6, 2.9], [0, 0.5, 0.5, 0]))
    return force, float(np.interp(t, [0.6, 1.1, 1.6], [-5e-3, 5e-3, -5e-3]))


def tapped(t: float) -> tuple[float, float]:
    """Force [N] and position [m] of taps of 0.5 N, 50 ms on and 50 ms off, at four places in turn."""
    tap = int(t / 0.05)
    return 0.5 * (tap % 2 == 0), (0.0, 3e-3, -3e-3, 2e-3)[tap // 2 % 4]


def times(node: ReducedFE, full_seconds: float) -> list[Row]:
    """Times of the node's steps in 3 s of each motion."""
    motions = {"slide": pressed_and_slid, "taps": tapped}
    return [{"motion": name} | timed(node, full_seconds, motion) for name, motion in motions.items()]


def timed(node: ReducedFE, full_seconds: float, motion: Callable[[float], tuple[float, float]]) -> Row:
    """Times of the node's steps in one motion: time [s] -> force [N], position along the finger [m]."""
    node.start()
    mesh = node.mesh()
    patch = spreader(mesh, 5e-3)
    spent, busy, evaluations, done = [], [], [], 0
    for k in range(3000):
        force, y = motion((k + 0.5) * 1e-3)
        top = mesh.vertices[
            np.argmin(
                np.abs(mesh.vertices[:, 0]) + np.abs(mesh.vertices[:, 1] - node.position[1] - y) - mesh.normals[:, 2]
            )
        ]
        foot = (float(node.position[0]), float(node.position[1]) + y, float(top[2]))
        normal = (0.0, 0.0, 1.0)
        count = spread(patch, foot, normal, (0.0, 0.0, -force)) if force > 0 else 0
        load = Load(nodes=patch.nodes[:count].copy(), forces=patch.forces[:count].copy(), foot=foot, normal=normal)
        begun, worked = time.perf_counter(), time.thread_time()
        node.step([load], dt=1e-3)
        spent.append(time.perf_counter() - begun)
        busy.append(time.thread_time() - worked)
        evaluations.append(int(node.own["evaluations"]))
        done += bool(node.own["settled"])
    middle = float(np.percentile(spent, 50))
    return {
        "step p50 us": 1e6 * middle,
        "step p99 us": 1e6 * float(np.percentile(spent, 99)),
        "of the core's time p50 us": 1e6 * float(np.percentile(busy, 50)),
        "p99 us": 1e6 * float(np.percentile(busy, 99)),
        "worst us": 1e6 * float(np.max(busy)),
        "evaluations mean": float(np.mean(evaluations)),
        "most": int(np.max(evaluations)),
        "settled %": 1e2 * done / len(spent),
        "full model s a load step": full_seconds,
        "ratio": full_seconds / middle,
    }


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--touches", type=int, default=6)
    options.add_argument("--modes", type=int, default=80)
    options.add_argument("--seed", type=int, default=77)
    given = options.parse_args()
    node = ReducedFE(surface="fingertip", model="sampled", modes=given.modes, young=160.0, radius=5e-3, reach=12e-3)
    basis = node.basis()
    assert isinstance(basis, SampledBasis)
    full = of_finger(FingertipDimensions(cells=CELLS))
    begun = time.perf_counter()
    presses = press_touches(full, finger_touches(full, given.touches, given.seed))
    seconds = (time.perf_counter() - begun) / max(sum(len(p.solutions) for p in presses), 1)
    node.start()
    shown = {
        "error by load": errors(full, presses, basis),
        "times": times(node, seconds),
        "basis": [
            {"modes": basis.modes.shape[1], "points": len(basis.points.kinds), "of": 4 * len(full.mesh.elements)}
        ],
    }
    print_tables(shown, given.json, digits=3)


if __name__ == "__main__":
    main()
