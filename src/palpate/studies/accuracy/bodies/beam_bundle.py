"""Beams in one layer with the thickness of the slab: with its modulus, and calibrated to ReducedFE."""

from functools import lru_cache
from typing import Any

from palpate.models.fe.meshing.organ import SLAB
from palpate.nodes.deformation import BeamBundle, ReducedFE
from palpate.studies.accuracy import chain
from palpate.studies.accuracy.bases import ready
from palpate.studies.accuracy.bodies import reduced_fe
from palpate.studies.accuracy.cases import TOUCHES, BenchCase
from palpate.studies.accuracy.fidelities import MESHES, NODULE, REACHES, STEPS, of_body, only_slab
from palpate.studies.accuracy.outcome import Method
from palpate.studies.fit_body import layer_constants
from palpate.studies.peers.continuum import POISSON, YOUNG

RATE = 1000.0  # [Hz] of the touch that calibrates


def methods() -> list[Method]:
    settings = (*STEPS, *MESHES, *REACHES)
    return [
        Method("BeamBundle", "BeamBundle, modulus of the slab", of_body(BeamBundle, _slab), settings, only_slab),
        Method(
            "BeamBundle-calibrated",
            "BeamBundle, calibrated",
            of_body(BeamBundle, _calibrate_beams),
            settings,
            only_slab,
        ),
    ]


def _slab(touch: BenchCase) -> dict[str, Any]:
    layer = {"layers": (SLAB,), "moduli": (YOUNG,), "relaxations": (touch.retardation,), "poisson": POISSON}
    return layer | {"radius": 8e-3} | (NODULE if touch.nodule else {})


def _calibrate_beams(touch: BenchCase) -> dict[str, Any]:
    """As `palpate fit body`: modulus and relaxation time from ReducedFE on one test case, used for all."""
    elastic = {"relaxations": (0.0,)} if touch.retardation == 0.0 else {}
    return _slab(touch) | _constants() | elastic


@lru_cache(maxsize=1)
def _constants() -> dict[str, Any]:
    """Constants that match the indentations of ReducedFE on `hold`."""
    touch = TOUCHES["hold"]
    body = reduced_fe.slab(touch) | {"model": "nonlinear"}
    surface = chain.surface_of(touch) | {"vertices": chain.VERTICES}
    ready(ReducedFE(**chain.surface_of(touch), **body))
    steps = [
        ([(load.nodes, load.forces, load.foot, load.normal)], [surface.previous_indentation])
        for _, _, load, surface in chain.sent_messages(touch, ReducedFE, RATE, body)
        if len(load.nodes)
    ]
    found, _ = layer_constants(BeamBundle(**surface, **_slab(touch)), steps, 1.0 / RATE)
    return {name: tuple(values) for name, values in found.items()}
