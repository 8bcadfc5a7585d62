"""Bases of the reduced bodies that do not ship: built once, and charged as offline time."""

from __future__ import annotations

import json
import time

from palpate.models.build.basis import Silent, built
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import SHIPPED, about, cache, find, key
from palpate.studies.accuracy.errors import UnsupportedError


def ready(node: ReducedFE, patient: bool = False) -> float:
    """Have the basis of these settings stored; the seconds that building it took, 0 for one that ships.

    patient  build a table at a hundred places too, which takes some minutes, and modes of a body other than the slab

    UnsupportedError: such a basis is not stored, and nobody is patient.
    """
    for folder in (SHIPPED, cache()):
        path = find(folder, node.key())
        if path is not None and node.stored(folder) is not None:
            return float((about(path) or {}).get("seconds", 0.0))
    long = {"nonlinear": "dents", "sampled": "modes" if node.surface != "plane" else ""}.get(node.model)
    if long and not patient:
        raise UnsupportedError(f"no basis with {long} is stored for these settings. Build it once: {node.command()}")
    begun = time.perf_counter()
    basis, _ = built(node, Silent(), check=False)
    seconds = time.perf_counter() - begun
    inputs = node.inputs()
    told = {"key": key(inputs), "inputs": inputs, "command": node.command(), "error": {}, "seconds": seconds}
    basis.save(cache() / node.filename(), json.dumps(told))
    return seconds
