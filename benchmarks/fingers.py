"""Time per tick of contact, spreading and body for one body under 1 to 5 fingers.

    python benchmarks/fingers.py [--json]

The fingers press the kidney 12 mm apart and slide. A time is the median over 600 steps. The remaining nodes of a graph
are independent of the number of fingers.
"""

from __future__ import annotations

import statistics
import time

import msgspec
from rich.progress import track
from tables import parser, print_tables

from palpate.messages import Pose, Surface
from palpate.nodes.collision import Nurbs
from palpate.nodes.contact.joint import Joint, Share
from palpate.nodes.contact.series import BODY
from palpate.nodes.deformation import MassSpring, ReducedFE
from palpate.nodes.spread import Kernel

STEPS = 600
VERTICES = 10_000
BODIES = MassSpring, ReducedFE


FORCE = frozenset(BODY.names) | {"laws", "slopes", "coupling"}
"""Fields of Surface that the contact reads."""


def measure(kind: type, count: int, shape: bool = False) -> dict[str, float]:
    """Median times [us] of the parts of a step with `count` fingers; `shape`: with the displacement of the body."""
    body, joint = kind(vertices=VERTICES), Joint()
    body.wanted = FORCE | ({"nodes", "displacement"} if shape else set())
    fingers = ((Nurbs(), Share(finger=i), Kernel(vertices=VERTICES)) for i in range(count))
    finds, shares, spreads = zip(*fingers, strict=True)
    for node in (body, joint, *finds, *shares, *spreads):
        node.start()
    surface: Surface | None = None
    times: dict[str, list[float]] = {"joint": [], "spread": [], "body": []}
    for tick in range(STEPS + 100):
        near = []
        for i, find in enumerate(finds):
            place = (12e-3 * (i - 0.5 * (count - 1)) + 5e-6 * tick, 0.0, 0.109 - 6e-3 * min(tick / 100, 1.0))
            found = find.step(Pose(position=place, velocity=(5e-3, 0.0, 0.0), dt=1e-3))
            near.append(msgspec.structs.replace(found, source=f"finger-{i}"))
        begun = time.perf_counter()
        contacts = joint.step(near, surface, dt=1e-3)
        solved = time.perf_counter()
        loads = [
            spread.step(share.step(contacts, one), None, dt=1e-3)
            for one, share, spread in zip(near, shares, spreads, strict=True)
        ]
        spread_at = time.perf_counter()
        surface = body.step(loads, dt=1e-3)
        ended = time.perf_counter()
        if tick >= 100:
            for part, span in zip(times, (solved - begun, spread_at - solved, ended - spread_at), strict=True):
                times[part].append(1e6 * span)
    medians = {part: statistics.median(values) for part, values in times.items()}
    whole = sum(medians.values())
    return medians | {"together": whole, "a finger": whole / count}


def main() -> None:
    given = parser(__doc__).parse_args()
    cases = [(kind, count, shape) for kind in BODIES for shape in (False, True) for count in (1, 2, 3, 5)]
    for kind in BODIES:
        measure(kind, 2)  # compile
    rows = [
        {"model": kind.__name__, "fingers": count, "shape": shape, **measure(kind, count, shape)}
        for kind, count, shape in track(cases, transient=True)
    ]
    print_tables({"µs of a step, kidney of 10 000 vertices": rows}, given.json)


if __name__ == "__main__":
    main()
