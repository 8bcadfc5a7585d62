"""Stores what the body computes at its start in the shipped bases, so that a first run need not compile it.

python benchmarks/extend_bases.py            # after a change of the start of the body
"""

from pathlib import Path

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.nodes.deformation import basis_store
from palpate.physics.archive import read_arrays, replacing
from palpate.physics.bodies.condensed_body import Start

BODY = "tissue.use=deformation.ReducedFE"


def extend(graph: str) -> Path:
    """Compute the start of the body of a graph, and store it in its basis; returns the path of the basis."""
    node = find(graph).but(overrides=(BODY,)).plan().make("tissue")
    path = basis_store.find(basis_store.SHIPPED, node.key())
    assert path is not None
    arrays = {name: array for name, array in read_arrays(path).items() if name not in ("start", *Start._fields)}
    with replacing(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)
    basis_store.start.cache_clear()
    start = Start.of(node._make_shared())
    lower = start.table[np.tril_indices(len(start.table))]
    assert (start.table == start.table.T).all()
    more = {**start._asdict(), "table": lower, "start": np.array(node.start_key(*node._place_basis()))}
    with replacing(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays, **more)
    return path


if __name__ == "__main__":
    print(extend("kidney"))
