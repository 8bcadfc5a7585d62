"""Failures that users of other simulators reported, rebuilt from their threads, run on those simulators and on palpate.

    python -m pip install mujoco drake felupe
    python benchmarks/graveyard.py [--json]

The peers are optional: a case whose peer is missing is named and left out. What stands in the table was run just now,
with the versions that it names; a thread's model that was not public is rebuilt in its spirit, and the table says so.
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
from tables import parser, tell

TITLE = "Reported failures, there and here"


def cases() -> list[tuple[str | None, str, str, Callable[[], str], Callable[[], str]]]:
    """The package that is needed, the case, who reported it, what happens there, what happens here."""
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
            "MuJoCo #1173, #1197 (no model of theirs: the beam)",
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
            "bodies go into one another",
            "MuJoCo #2084, the same slab with the integrator that holds",
            lambda: graveyard_mujoco.slab("discrete"),
            here.penetration,
        ),
        (
            "mujoco",
            "a turned sheet diverges, a level one does not",
            "MuJoCo #2562, rebuilt",
            graveyard_mujoco.turned,
            here.turned,
        ),
        (
            "drake",
            "a thrown box makes energy",
            "Drake #18241 (its models are not public: boxes of 0.1 m and 0.5 kg)",
            graveyard_drake.thrown,
            here.thrown,
        ),
        (
            "felupe",
            "a nearly incompressible block locks",
            "what linear tetrahedra are known for; FElupe's default solid",
            graveyard_felupe.locked,
            graveyard_felupe.mixed,
        ),
        (
            None,
            "a haptic loop makes energy",
            "a sampled spring, written for the purpose (compare Drake #18241)",
            lambda: here.throws(controlled=False),
            here.thrown,
        ),
    ]


LEFT_OUT = "not rebuilt: MuJoCo #1847 (its mesh is not public), ppf-contact-solver #117 (needs a CUDA device)"


def main() -> None:
    given = parser(__doc__).parse_args()
    told, rows = Console(file=sys.stderr), []
    memory: dict[Any, str] = {}
    for package, case, reported, there, ours in track(cases(), "cases", console=told):
        if package is not None and importlib.util.find_spec(package) is None:
            told.print(f"left out: {case} (python -m pip install {package})")
            continue
        peer = f"{package} {version(package)}" if package else "naive"
        if ours not in memory:
            memory[ours] = ours()
        rows.append({"case": case, "reported": reported, "peer": peer, "there": there(), "here": memory[ours]})
    told.print(LEFT_OUT)
    tell({TITLE: rows}, given.json)


if __name__ == "__main__":
    main()
