"""Failures that users of other simulators reported, reproduced with those simulators and with palpate.

    python -m pip install mujoco drake felupe
    python benchmarks/graveyard.py [--json]

The simulators are optional: the script skips cases whose simulator is not installed, and lists them. Each call runs all
cases with the installed versions, which the table names. Some reports have no public model; the table marks their
substitutes.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import graveyard_drake
import graveyard_felupe
import graveyard_here as here
import graveyard_mujoco
from rich.console import Console
from rich.progress import track
from tables import parser, print_tables

TITLE = "Reported failures, there and here"


def cases() -> list[tuple[str | None, str, str, Callable[[], str], Callable[[], str]]]:
    """Required package, case, report, function for that package, function for palpate; each returns the outcome."""
    return [
        (
            "mujoco",
            "a soft beam diverges at the default step",
            "MuJoCo #1141, the model of the thread",
            graveyard_mujoco.beam,
            here.rates,
        ),
        (
            "mujoco",
            "a soft beam diverges as it becomes incompressible",
            "MuJoCo #1173, #1197 (their model is not public: the beam of #1141)",
            graveyard_mujoco.incompressible,
            here.incompressible,
        ),
        (
            "mujoco",
            "soft tissue diverges under a ball",
            "MuJoCo #2084, #2109, as a slab of 60 x 60 x 20 mm at 1 ms",
            lambda: graveyard_mujoco.slab("Euler"),
            here.moduli,
        ),
        (
            "mujoco",
            "bodies interpenetrate",
            "MuJoCo #2084, the same slab with the integrator that stays finite",
            lambda: graveyard_mujoco.slab("discrete"),
            here.penetration,
        ),
        (
            "mujoco",
            "a rotated sheet diverges, a level one does not",
            "MuJoCo #2562, model rebuilt from the description",
            graveyard_mujoco.turned,
            here.turned,
        ),
        (
            "drake",
            "a thrown box gains energy",
            "Drake #18241 (its models are not public: boxes of 0.1 m and 0.5 kg)",
            graveyard_drake.thrown,
            here.thrown,
        ),
        (
            "felupe",
            "a nearly incompressible block locks",
            "known of linear tetrahedra; FElupe's default solid",
            graveyard_felupe.locked,
            graveyard_felupe.mixed,
        ),
        (
            None,
            "a haptic loop generates energy",
            "a sampled spring without controller (compare Drake #18241)",
            lambda: here.throws(controlled=False),
            here.thrown,
        ),
    ]


LEFT_OUT = "not reproduced: MuJoCo #1847 (its mesh is not public), ppf-contact-solver #117 (needs a CUDA device)"


def main() -> None:
    given = parser(__doc__).parse_args()
    log, rows = Console(file=sys.stderr), []
    memory: dict[Any, str] = {}
    for package, case, reported, there, ours in track(cases(), "cases", console=log):
        if package is not None and importlib.util.find_spec(package) is None:
            log.print(f"left out: {case} (python -m pip install {package})")
            continue
        peer = f"{package} {version(package)}" if package else "naive"
        if ours not in memory:
            memory[ours] = ours()
        rows.append({"case": case, "reported": reported, "peer": peer, "there": there(), "here": memory[ours]})
    log.print(LEFT_OUT)
    print_tables({TITLE: rows}, given.json)


if __name__ == "__main__":
    main()
