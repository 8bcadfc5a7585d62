"""The start of the reduced body that its basis contains has the bits that the body computes."""

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.nodes.deformation import basis_store
from palpate.physics.bodies.condensed_body import Start

GRAPH = find("kidney").but(overrides=("tissue.use=deformation.ReducedFE",))


def body(*sets, stored=True, monkeypatch=None):
    node = GRAPH.but(overrides=sets).plan().make("tissue")
    found = node._start(*node._place_basis())
    if not stored:
        monkeypatch.setattr(basis_store, "start", lambda path, wanted: None)
    made = Start.of(node._make_shared())
    monkeypatch.undo()
    return found, made


def test_the_stored_start_is_used_and_equals_the_computed_one(monkeypatch):
    """Also for another modulus and retardation time, which the stored one does not depend on."""
    found, used = body(monkeypatch=monkeypatch)
    assert found is not None and all(a is b for a, b in zip(found, used, strict=True))
    for sets in ((), ("tissue.young=3100", "tissue.retardation=0.005", "tissue.reach=0.02")):
        found, computed = body(*sets, stored=False, monkeypatch=monkeypatch)
        assert found is not None
        for a, b in zip(found, computed, strict=True):
            assert a.dtype == b.dtype and np.array_equal(a, b)


def test_another_place_or_law_computes_its_start(monkeypatch):
    for sets in (("tissue.sticks=false",), ("scene.surface.position=[0.001, 0, 0]",), ("tissue.radius=0.005",)):
        node = GRAPH.but(overrides=sets).plan().make("tissue")
        assert node._start(*node._place_basis()) is None
