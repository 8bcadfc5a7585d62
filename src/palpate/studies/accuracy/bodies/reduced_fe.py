"""Reduced finite elements, linear and nonlinear. `sampled` models the fingertip, which is in no test case.

The time to build a basis that does not ship counts as offline time.
"""

from collections.abc import Callable
from typing import Any

from palpate.nodes.deformation import ReducedFE
from palpate.studies.accuracy import chain
from palpate.studies.accuracy.bases import ready
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.fidelities import MESHES, NODULE, REACHES, SECOND_ORDER, STEPS, of_body, only_slab
from palpate.studies.accuracy.outcome import Fidelity, Method, MethodOutcome
from palpate.studies.peers.continuum import BED, POISSON, RADIUS, YOUNG

BALL = {"area": "ball", "area_radius": RADIUS, "area_modulus": YOUNG / (1.0 - POISSON**2)}
"""The contact of the rigid ball grows with the force."""


def methods() -> list[Method]:
    condensed = [Fidelity(f"condensed to {n} vertices", settings={"body": {"coarse": n}}) for n in (150, 300, 600)]
    few, some = (*STEPS, SECOND_ORDER, *MESHES[1:]), REACHES[:2]
    return [
        Method("ReducedFE-linear", "ReducedFE, linear", _reducing("linear"), (*few, *condensed, *some), only_slab),
        Method("ReducedFE", "ReducedFE", _reducing("nonlinear"), (*few, *some), only_slab),
    ]


def slab(touch: BenchCase) -> dict[str, Any]:
    material = {"young": YOUNG, "poisson": POISSON, "bed": BED, "retardation": touch.retardation}
    area = BALL if touch.finger == "ball" else {}
    return material | {"sticks": touch.sticks} | area | (NODULE if touch.nodule else {})


def _reducing(model: str) -> Callable[[BenchCase, Fidelity, int], MethodOutcome]:
    def compute(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
        body = slab(touch) | {"model": model} | fidelity.settings.get("body", {})
        node = ReducedFE(**chain.surface_of(touch), **body)
        offline = ready(node)
        outcome = of_body(ReducedFE, lambda touch: body)(touch, fidelity, repeats)
        outcome.offline += offline
        return outcome

    return compute
