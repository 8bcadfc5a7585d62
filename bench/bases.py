"""Bases of the reduced bodies that do not ship: built once, as `palpate reduce` does, and charged as offline time."""

from __future__ import annotations

import json
import os
import time

import numpy as np

from palpate.bench.errors import Refused
from palpate.models.fe.meshing.organ import Nodule, Organ
from palpate.models.fe.reduce.dents import dent_table
from palpate.models.fe.reduce.reducible import of_organ
from palpate.models.fe.reduce.reduction import build, organ_pressed
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import SHIPPED, about, cache, find, key
from palpate.physics.bodies.condensed_body import Basis
from palpate.physics.bodies.sampled_body import SampledBasis


def ready(node: ReducedFE, patient: bool = False) -> float:
    """Have the basis of these settings stored; the seconds that building it took, 0 for one that ships.

    patient  build dents at a hundred places too, which takes some minutes, and modes of a body other than the slab

    Refused: such a basis is not stored, and nobody is patient.
    """
    for folder in (SHIPPED, cache()):
        path = find(folder, node.key())
        if path is not None and node.stored(folder) is not None:
            return float((about(path) or {}).get("seconds", 0.0))
    long = {"nonlinear": "dents", "sampled": "modes" if node.surface != "plane" else ""}.get(node.model)
    if long and not patient:
        raise Refused(f"no basis with {long} is stored for these settings. Build it once: {node.command()}")
    begun = time.perf_counter()
    nodule = Nodule(node.nodule_centre, node.nodule_radius, node.nodule_ratio)
    organ = of_organ(Organ(node.coarse_mesh(), node.poisson, node.bed, nodule))
    basis: Basis | SampledBasis
    if node.model == "sampled":
        basis = build(organ, *organ_pressed(organ, lambda share: None), node.modes, lambda share: None)
    else:
        surface = organ.surface
        dents = dent_table(organ) if node.model == "nonlinear" else np.zeros((len(surface.vertices), 0))
        basis = Basis(surface.vertices, surface.triangles, organ.compliance(), dents)
    seconds = time.perf_counter() - begun
    inputs = node.inputs()
    told = {"key": key(inputs), "inputs": inputs, "command": node.command(), "error": {}, "seconds": seconds}
    path = cache() / node.filename()
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{os.getpid()}.npz")
    basis.save(part, json.dumps(told))
    part.replace(path)
    return seconds
