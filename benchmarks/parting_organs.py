"""A finger presses an organ into its neighbour and releases it, at 1 to 16 kHz: python benchmarks/parting_organs.py

Balls of 42 mm, 1 mm apart (ReducedFE, 19 kPa), of which the upper one is attached at its side. The finger moves into it
by 8 mm in 80 ms and back, and the lower one up by 2.5 mm and back with its foundation. The largest change of its force
in a tick, and per second, on both organs and on the upper one alone, on the way in and on the way out, and the forces
at the tick of the largest change on the way out. A continuous force changes in a tick in proportion to the tick.

Then the first touch of the two balls, without a finger, that approach each other at v = 8 mm/s, for several rates and
sizes of cells: the force after the first two ticks that touch, v (T + tau)/C of the cell that touches, and v tau/C.
"""

import argparse
import dataclasses
import json
from typing import Any

import numpy as np

from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.contact.between import Between
from palpate.studies.organ_pairs import Case, motion, run, support_at

RADIUS, GAP, FAR, DEPTH, CLOSING, DURATION = 21e-3, 1e-3, 30e-3, 8e-3, 2.5e-3, 80e-3  # [m], [s]
VERTICES, ROTATION = 2000, (0.0, float(np.pi / 2.0), 0.0)
SPEED, TAU = 8e-3, 10e-3  # [m/s], [s]
RATES = (1000, 2000, 4000, 8000, 16000)  # [Hz]


def case(retardation: float) -> Case:
    """Two balls of a retardation [s], and a finger on top of the upper one."""
    bodies: list[dict[str, Any]] = []
    for z in (2.0 * RADIUS + GAP, 0.0):
        surface = {"surface": "sphere", "vertices": VERTICES, "position": (0.0, 0.0, z),
                   "rotation": ROTATION if z else (0.0, 0.0, 0.0)}  # fmt: skip
        given = {"young": 19e3, "model": "linear", "retardation": retardation}
        bodies.append({"use": "ReducedFE", "settings": given | surface, "surface": surface})
    ball = surface_mesh("sphere", VERTICES, (0.0, 0.0, 2.0 * RADIUS + GAP), ROTATION)
    top = int(np.argmax(ball.vertices[:, 2]))
    upper, lower = bodies
    return Case(0, upper, lower, GAP, DEPTH, CLOSING, DURATION, ball.vertices[top], ball.normals[top])


def apart(touching: Case) -> Case:
    """The same with the lower ball out of reach."""
    lower = {**touching.lower, "surface": {**touching.lower["surface"], "position": (0.0, 0.0, -FAR)}}
    lower["settings"] = {**lower["settings"], "position": (0.0, 0.0, -FAR)}
    return dataclasses.replace(touching, lower=lower)


def report(retardation: float, rate: int) -> None:
    both = case(retardation)
    pair, alone = run(both, dt=1.0 / rate), run(apart(both), dt=1.0 / rate)
    felt, one = (np.array([each.force for each in course.contacts]) for course in (pair, alone))
    turn = int(np.argmax(motion(both, 1.0 / rate))) + 1
    changes, only = np.abs(np.diff(felt)), np.abs(np.diff(one))
    at = turn + int(np.argmax(changes[turn:]))
    organs = max(each.force for each in pair.between)
    print(
        f"{1e3 * retardation:g} ms, {rate} Hz: organs {organs:.3f} N; in {changes[:turn].max():.4f} N "
        f"({changes[:turn].max() * rate:.0f} N/s), alone {only[:turn].max():.4f}; out {changes[turn:].max():.4f} N "
        f"({changes[turn:].max() * rate:.1f} N/s), alone {only[turn:].max():.4f} ({only[turn:].max() * rate:.1f} N/s), "
        f"ratio {changes[turn:].max() / only[turn:].max():.3f}; forces there {felt[at]:.3f} and {one[at]:.3f} N",
        flush=True,
    )


def touch(rate: int, vertices: tuple[int, int], cells: int) -> None:
    """The first touch of two balls, of which the upper one moves down."""
    bodies: list[dict[str, Any]] = []
    for z, count in zip((2.0 * RADIUS + GAP, 0.0), vertices, strict=True):
        surface = {"surface": "sphere", "vertices": count, "position": (0.0, 0.0, z)}
        given = {"young": 19e3, "model": "linear", "retardation": TAU, "organ_loads": 1}
        bodies.append({"use": "ReducedFE", "settings": given | surface, "surface": surface})
    between, dt, tick = Between(bodies=json.dumps(bodies), cells=cells), 1.0 / rate, 0
    between.start()
    forces: list[float] = []
    while len(forces) < 2:
        tick += 1
        down = np.array([0.0, 0.0, -SPEED * tick * dt])
        force = between.step([], [], first_support=support_at(down), dt=dt).force
        forces += [force] if force > 0.0 else []
    held = between._held
    cell = int(np.argmax(held["pair.active.force"]))
    compliance = held["pair.first"][cell, cell] + held["pair.second"][cell, cell]
    limits = [1e3 * SPEED * (step + TAU) / compliance for step in (dt, 0.0)]
    print(
        f"first touch, cell of {1e6 * held['areas'][cell]:.1f} mm2, {rate} Hz: {1e3 * forces[-1]:.3f} mN, "
        f"v (T + tau)/C {limits[0]:.3f} mN, v tau/C {limits[1]:.3f} mN",
        flush=True,
    )


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    for retardation in (1e-3, 10e-3):
        for rate in RATES:
            report(retardation, rate)
    for vertices, cells in (((10000, 10000), 160), ((2600, 2000), 160), ((10000, 10000), 512)):
        for rate in (1000, 8000, 16000):
            touch(rate, vertices, cells)


if __name__ == "__main__":
    main()
