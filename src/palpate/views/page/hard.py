"""Hard cases that the page runs on request: the body far stiffer, and a stab at the speed of an arm.

Each changes settings of the run; the page then moves the pointer through the same touch: a press at once to a depth, a
slide, and a lift. The page reports whether all numbers stayed finite, the largest force, and the limit that the
controller keeps to (tests/hard has these and other cases, docs/stability.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from palpate.engine.graph import Graph
from palpate.nodes.controller import Haptic
from palpate.nodes.device.mouse import Mouse

STIFFER = 1000
STIFFNESS = ("stiffness", "tangential_stiffness", "young", "moduli")
"""Settings of bodies that are elastic moduli or spring constants."""
DEPTH = 0.012  # [m] of the target below the surface: deeper than a press of the shipped scenes
STAB = {"speed": 2.0, "lag": 1e-3}
"""Settings of `device.Mouse`: its greatest speed [m/s] and shortest lag [s], of which the target is reached at once."""
STAB_DEPTH = 0.03  # [m]


@dataclass(frozen=True)
class HardCase:
    """One case.

    title      for people
    depth      [m] of the pointer's target below the surface
    overrides  as for `--set`
    """

    name: str
    title: str
    depth: float
    overrides: tuple[str, ...]


def hard_cases(graph: Graph, bodies: Sequence[str]) -> list[HardCase]:
    """The cases that fit a steered graph.

    bodies  names of its nodes that are bodies; a body without an elastic setting has no stiffer form
    """
    cases = []
    stiffer = [each for body in bodies for each in _stiffer(graph, body)]
    if stiffer:
        cases.append(HardCase("stiff", f"stiffness × {STIFFER}", DEPTH, tuple(stiffer)))
    hands = [spec.name for spec in graph.nodes.values() if issubclass(spec.cls, Mouse)]
    fast = tuple(f"{hand}.{key}={value:g}" for hand in hands for key, value in STAB.items())
    cases.append(HardCase("stab", f"stab of {1e3 * STAB_DEPTH:g} mm at {STAB['speed']:g} m/s", STAB_DEPTH, fast))
    return cases


def force_limit(graph: Graph) -> float | None:
    """[N] Largest force on the hand that the controllers of a graph permit. None: it has no controller."""
    limits = [
        float(spec.settings.get("limit", Haptic.limit)) for spec in graph.nodes.values() if issubclass(spec.cls, Haptic)
    ]
    return max(limits, default=None)


def for_page(cases: Sequence[HardCase]) -> list[dict[str, Any]]:
    return [{"name": case.name, "title": case.title, "depth": case.depth} for case in cases]


def _stiffer(graph: Graph, body: str) -> list[str]:
    """The overrides that multiply all elastic settings of a body."""
    spec = graph.nodes[body]
    values = {name: spec.settings.get(name, getattr(spec.cls, name, None)) for name in STIFFNESS}
    return [f"{body}.{name}={_times(value)}" for name, value in values.items() if value is not None]


def _times(value: Any) -> str:
    if isinstance(value, int | float):
        return repr(STIFFER * float(value))
    return str([STIFFER * float(each) for each in value])
