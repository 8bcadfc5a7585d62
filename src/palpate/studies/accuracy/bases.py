"""Bases of deformation.ReducedFE for test cases: the shipped one, or built once."""

import json
import time

from palpate.models.build.basis import build_basis, silent
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import SHIPPED, about, cache, find, key


def ready(node: ReducedFE) -> float:
    """Build and store the basis of these settings if it is missing; the time [s] to build it, 0 for a shipped one."""
    for folder in (SHIPPED, cache()):
        path = find(folder, node.key())
        if path is not None and node.find_stored(folder) is not None:
            return float((about(path) or {}).get("seconds", 0.0))
    begun = time.perf_counter()
    basis, _ = build_basis(node, silent, check=False)
    seconds = time.perf_counter() - begun
    inputs = node.inputs()
    content = {"key": key(inputs), "inputs": inputs, "command": node.command(), "error": {}, "seconds": seconds}
    basis.save(cache() / node.filename(), json.dumps(content))
    return seconds
