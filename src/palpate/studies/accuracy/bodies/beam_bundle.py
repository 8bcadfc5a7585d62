"""Beams in one layer with the thickness of the slab."""

from typing import Any

from palpate.models.fe.meshing.organ import SLAB
from palpate.nodes.deformation import BeamBundle
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.fidelities import MESHES, NODULE, REACHES, STEPS, of_body, only_slab
from palpate.studies.accuracy.outcome import Method
from palpate.studies.peers.continuum import POISSON, YOUNG


def methods() -> list[Method]:
    return [Method("BeamBundle", "BeamBundle", of_body(BeamBundle, _slab), (*STEPS, *MESHES, *REACHES), only_slab)]


def _slab(touch: BenchCase) -> dict[str, Any]:
    layer = {"layers": (SLAB,), "moduli": (YOUNG,), "relaxations": (touch.retardation,), "poisson": POISSON}
    return layer | {"radius": 8e-3} | (NODULE if touch.nodule else {})
