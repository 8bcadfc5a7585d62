"""Springs with Hertz's law; with and without a surface."""

from typing import Any

from palpate.nodes.deformation import MassSpring
from palpate.studies.accuracy import chain
from palpate.studies.accuracy.fidelities import NODULE, meshes, of_body, only_slab, reaches, spread, steps
from palpate.studies.accuracy.outcome import Method
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.accuracy.truth import HERTZ


class _Silent(MassSpring):
    """The terminal law alone: nobody asks for the surface."""

    wanted = chain.LAW


def methods() -> list[Method]:
    forms = [spread("kernel", kernel, kernel) for kernel in ("wendland", "cosine")]
    finer = (*steps(), *meshes(), *reaches(), *forms)
    return [
        Method("series", "laws in series, no surface", of_body(_Silent, _slab), tuple(steps()), _no_nodule),
        Method("MassSpring", "MassSpring", of_body(MassSpring, _slab), finer, only_slab),
    ]


def _slab(touch: BenchCase) -> dict[str, Any]:
    """Hertz's law for the ball; its own default damping where the slab is viscous."""
    law: dict[str, Any] = {"stiffness": HERTZ, "exponent": 1.5}
    if touch.retardation == 0.0:
        law["damping"] = 0.0
    return law | (NODULE if touch.nodule else {})


def _no_nodule(touch: BenchCase) -> str:
    return only_slab(touch) or ("a law knows of no nodule" if touch.nodule else "")
