"""Reduced finite elements: linear, condensed, sampled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import shipped
from palpate.studies.accuracy import bases, chain
from palpate.studies.accuracy.continuum import BED, POISSON, YOUNG
from palpate.studies.accuracy.fidelities import meshes, of_body, only_slab, reaches, steps
from palpate.studies.accuracy.outcome import Fidelity, Method, MethodOutcome
from palpate.studies.accuracy.touches import BenchCase


def methods(patient: bool) -> list[Method]:
    """Each model; patient: whether a basis that is not stored is built even where that takes minutes."""
    condensed = [
        Fidelity(f"condensed to {n} vertices", "basis", settings={"body": {"coarse": n}}) for n in (150, 300, 600)
    ]
    few, some = (*steps(), *meshes((1000, 3000, 10000))), reaches()[:2]
    sampled = _reducing("sampled", patient, modes=20, coarse=150)
    return [
        Method("ReducedFE-linear", "ReducedFE linear", _reducing("linear"), (*few, *condensed, *some), only_slab),
        Method("ReducedFE", "ReducedFE condensed", _reducing("nonlinear", patient), (*few, *some), only_slab),
        Method("ReducedFE-sampled", "ReducedFE sampled", sampled, tuple(steps()), only_slab),
    ]


def _reduced(model: str) -> Callable[[BenchCase], dict[str, Any]]:
    def own(touch: BenchCase) -> dict[str, Any]:
        outcome: dict[str, Any] = {"model": model, "young": YOUNG, "poisson": POISSON, "bed": BED,
                                 "retardation": touch.retardation, "sticks": touch.sticks}  # fmt: skip
        if touch.nodule:
            outcome |= {"nodule_centre": (0.0, 0.0, -6e-3), "nodule_radius": 4e-3, "nodule_ratio": 10.0}
        return outcome

    return own


def _reducing(
    model: str, patient: bool = False, **fixed: object
) -> Callable[[BenchCase, Fidelity, int], MethodOutcome]:
    """With its basis built where none is stored, and with what a stored one says of its error."""

    def compute(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
        own = _reduced(model)(touch) | fixed | fidelity.settings.get("body", {})
        node = ReducedFE(**chain.surface_of(touch), **own)
        offline = bases.ready(node, patient)
        outcome = of_body(ReducedFE, lambda touch: own)(touch, fidelity, repeats)
        outcome.offline += offline
        errors = [about["error"] for about in shipped().values() if about["key"] == node.key()]
        if model != "linear" and errors and errors[0]:
            outcome.estimated_error = float(errors[0]["mean"])
        return outcome

    return compute
