"""The settings of methods in the benchmark, and the computation of a test case with a body."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from palpate.nodes.base import Node
from palpate.studies.accuracy import between_organs, chain
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.outcome import Fidelity, MethodOutcome
from palpate.studies.peers.continuum import NODULE_DEPTH, NODULE_RADIUS, NODULE_RATIO

STEPS = tuple(Fidelity(f"{rate:g} Hz", rate, quick=rate == 1000.0) for rate in (250.0, 500.0, 1000.0, 2000.0, 4000.0))
MESHES = tuple(
    Fidelity(f"{n} vertices", settings={"surface": {"vertices": n}}, quick=n == 1000) for n in (400, 1000, 3000, 10000)
)
REACHES = tuple(Fidelity(f"kernel of {1e3 * r:g} mm", settings={"spread": {"radius": r}}) for r in (4e-3, 6e-3, 10e-3))
SECOND_ORDER = Fidelity(
    "second order", settings={"contact": {"second_order": True}, "body": {"second_order": True}}, quick=True
)
"""Steps of second order at 1 kHz."""
NODULE = {"nodule_radius": NODULE_RADIUS, "nodule_depth": NODULE_DEPTH, "nodule_ratio": NODULE_RATIO}


def of_body(
    cls: type[Node], settings: Callable[[BenchCase], dict[str, Any]]
) -> Callable[[BenchCase, Fidelity, int], MethodOutcome]:
    """`Method.compute` of a body, with its settings for a test case."""

    def compute(touch: BenchCase, fidelity: Fidelity, repeats: int) -> MethodOutcome:
        given = dict(fidelity.settings)
        given["body"] = settings(touch) | given.get("body", {})
        if touch.body == "organs":
            return between_organs.run(touch, cls, replace(fidelity, settings=given), repeats)
        finger = chain.BALL if touch.finger == "ball" else {}
        return chain.run(touch, cls, replace(fidelity, settings=given), finger, repeats)

    return compute


def only_slab(touch: BenchCase) -> str:
    """Reason why a body does not support a test case, or ""."""
    return "the plate is rigid: no body to compute" if touch.body == "plate" else ""
