"""The rigs and laws of the search, with random sizes and true parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.models.fit.tissue.rigs import Law, Rig

AFM = 0.25  # [1] Share of the balls that are colloids of a force microscope


@dataclass(frozen=True)
class Case:
    """What presses: a rig and a law with its true parameters. `reach` [m] is the greatest indentation.

    For a law tabulated by finite elements `force` is the true one, [N] (n,) of indentations [m] (n,) > 0, and `table`
    the law for the fit.
    """

    rig: Rig
    law: str
    relaxation: str
    truth: dict[str, float]
    reach: float
    force: Callable[[np.ndarray], np.ndarray] | None = field(default=None, compare=False)
    table: Law | None = field(default=None, compare=False)


def _spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Log-uniform."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _ball(law: str, relaxation: str = "none") -> Callable[[np.random.Generator], Case]:
    def draw_case(rng: np.random.Generator) -> Case:
        small = law in ("hertz", "power") and relaxation == "none" and rng.uniform() < AFM
        radius = _spread(rng, 2e-6, 2e-5) if small else _spread(rng, 2e-3, 2e-2)
        height = radius * _spread(rng, 1.0, 4.0) if law == "layer" else None
        most = min(0.25 * radius, 0.15 * height, height**2 / radius) if height else 0.1 * radius
        reach = rng.uniform(0.3, 0.95) * most
        return Case(Rig("ball", radius, height), law, relaxation, _truth(law, relaxation, rng, radius, reach), reach)

    return draw_case


def _punch(law: str) -> Callable[[np.random.Generator], Case]:
    def draw_case(rng: np.random.Generator) -> Case:
        radius = _spread(rng, 1e-3, 2e-2)
        reach = rng.uniform(0.02, 0.19) * radius
        return Case(Rig("punch", radius), law, "none", _truth(law, "none", rng, radius, reach), reach)

    return draw_case


def _fingertip(rng: np.random.Generator) -> Case:
    truth = {"stiffness": _spread(rng, 5e2, 2e4), "exponent": rng.uniform(1.2, 2.0)}
    return Case(Rig("fingertip"), "power", "none", truth, rng.uniform(1.5e-3, 5e-3))


def _cylinder(law: str) -> Callable[[np.random.Generator], Case]:
    def draw_case(rng: np.random.Generator) -> Case:
        radius = _spread(rng, 3e-3, 3e-2)
        height = radius * rng.uniform(0.6, 2.0)
        reach = height * rng.uniform(0.1, 0.45)
        return Case(Rig("cylinder", radius, height), law, "none", _truth(law, "none", rng, radius, reach), reach)

    return draw_case


def _truth(law: str, relaxation: str, rng: np.random.Generator, radius: float, reach: float) -> dict[str, float]:
    """True parameters of a law."""
    young = _spread(rng, 5e2, 1e5)
    if law == "power":
        exponent = rng.uniform(1.2, 2.2)
        out = {"stiffness": young * math.sqrt(radius) * reach ** (1.5 - exponent), "exponent": exponent}
    elif law == "exponential":
        hardening = rng.uniform(0.5, 4.0) / reach
        out = {"stiffness": young * math.sqrt(radius * reach) * 0.5, "hardening": hardening}
    else:
        out = {"young": young}
    out |= {
        "ogden": {"alpha": rng.uniform(3.0, 12.0)}, "demiray": {"b": _spread(rng, 0.3, 3.0)},
        "yeoh": {"c2_over_c1": rng.uniform(0.05, 1.0)},
        "ogden2": {
            "share": rng.uniform(0.05, 0.5), "alpha_1": rng.uniform(1.0, 5.0), "alpha_2": rng.uniform(8.0, 20.0),
        },
        "yeoh3": {"c2_over_c1": rng.uniform(-0.1, 0.5), "c3_over_c1": _spread(rng, 0.02, 1.0)},
    }.get(law, {})  # fmt: skip
    out |= {
        "kelvin-voigt": {"retardation": _spread(rng, 0.05, 0.5)},
        "hunt-crossley": {"damping": 0.5 / reach * _spread(rng, 0.3, 3.0)},
        "prony:1": {"share_1": rng.uniform(0.2, 0.7), "time_1": _spread(rng, 0.3, 3.0)},
        "prony:2": _terms(rng, 2), "prony:3": _terms(rng, 3),
    }.get(relaxation, {})  # fmt: skip
    return out


def _terms(rng: np.random.Generator, count: int) -> dict[str, float]:
    """Prony terms from the slowest to the fastest, each 4 to 10 times faster than the one before."""
    out: dict[str, float] = {}
    time = _spread(rng, 1.0, 3.0)
    for i in range(1, count + 1):
        out |= {f"share_{i}": rng.uniform(0.15, 0.5), f"time_{i}": time}
        time /= rng.uniform(4.0, 10.0)
    return out


RUBBER = ("linear", "neo_hooke", "ogden", "demiray", "yeoh", "ogden2", "yeoh3")
RELAXING = ("kelvin-voigt", "hunt-crossley", "prony:1", "prony:2", "prony:3")
CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    "ball hertz": _ball("hertz"), "ball layer": _ball("layer"), "ball power": _ball("power"),
    "ball exponential": _ball("exponential"), "punch hertz": _punch("hertz"), "punch power": _punch("power"),
    "punch exponential": _punch("exponential"), "fingertip power": _fingertip,
    **{f"cylinder {law}": _cylinder(law) for law in RUBBER},
    **{f"ball layer {kind}": _ball("layer", kind) for kind in RELAXING},
}  # fmt: skip
"""Laws with a closed form and up to three parameters; `tables.TABULATED` has those of finite elements."""
