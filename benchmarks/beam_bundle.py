"""Time of a step of the beam bundle by the number of beams: python benchmarks/beam_bundle.py [--json]

The default fingertip presses a plate at 20° by 2 mm and slides at 2 mm/s, at 1 kHz, from stick to gross slip. One row
per pitch; `solver`: the physics alone, `node`: the whole step of fingertip.BundleContact with its four messages. Times
are processor time of the thread [ms], which other programs affect less than wall time. Goal: a node step within 1 ms at
1.2 mm.
"""

from __future__ import annotations

import json
import time

import numpy as np
from tables import parser, show

from palpate.messages import Pose
from palpate.nodes.fingertip import BundleContact
from palpate.physics.fingertip.beam_bundle import BundleState, step

DT, SPEED, DEPTH = 1e-3, 2e-3, 2e-3
PITCHES = (2.4e-3, 1.2e-3, 0.6e-3, 0.3e-3)


def measure(pitch: float, steps: int) -> dict[str, float]:
    """Times [ms] for one pitch [m] over a slide of `steps` steps."""
    node = BundleContact(pitch=pitch, reach=DEPTH)
    begin = time.perf_counter()
    node.start()
    start = time.perf_counter() - begin
    top = node.thickness
    press = [pose(top - DEPTH * k / 20, 0.0) for k in range(1, 21)]
    slide = [pose(top - DEPTH, SPEED * DT * k) for k in range(1, steps + 1)]

    # the solver alone: press to DEPTH, then slide
    bundle, state = node.bundle, BundleState(node.bundle)
    for one in press:
        step(bundle, state, top - one.position[2], (0, 0), node.friction, 0.1)
    solver, rounds, residual = [], [], []
    for _ in slide:
        begin = time.thread_time_ns()
        step(bundle, state, DEPTH, (0, SPEED * DT), node.friction, DT, most=node.iterations)
        solver.append(time.thread_time_ns() - begin)
        rounds.append(state.summary.iterations)
        residual.append(state.summary.residual)

    # the same with the whole node
    for one in press:
        node.step(one, dt=0.1)
    whole = []
    for one in slide:
        begin = time.thread_time_ns()
        node.step(one, dt=DT)
        whole.append(time.thread_time_ns() - begin)
    return {
        "pitch_mm": pitch * 1e3,
        "beams": len(bundle.heights),
        "start_s": start,
        "solver_p50_ms": float(np.percentile(solver, 50)) * 1e-6,
        "solver_p99_ms": float(np.percentile(solver, 99)) * 1e-6,
        "node_p50_ms": float(np.percentile(whole, 50)) * 1e-6,
        "node_p99_ms": float(np.percentile(whole, 99)) * 1e-6,
        "node_max_ms": float(np.max(whole)) * 1e-6,
        "rounds_mean": float(np.mean(rounds)),
        "rounds_max": float(np.max(rounds)),
        "residual_max": float(np.max(residual)),
    }


def pose(height: float, y: float) -> Pose:
    """The bone edge at a height and a position y along the plate [m]."""
    return Pose(position=(0, y, height), velocity=(0, 0, 0), dt=DT)


def main() -> None:
    """Measure every pitch and print one table."""
    options = parser(__doc__)
    options.add_argument("--fast", action="store_true", help="leave out the finest pitch")
    given = options.parse_args()
    measure(PITCHES[0], 100)  # compiles
    rows = [measure(p, 1200) for p in (PITCHES[:-1] if given.fast else PITCHES)]
    if given.json:
        print(json.dumps(rows))
        return
    show("Beam bundle: time of a step", rows, digits=3)
    print("Goal: node p99 within 1 ms at 1.2 mm. The residual is relative to the largest friction limit.")


if __name__ == "__main__":
    main()
