"""A body without a mesh is shown on the surface to which its load is spread."""

import numpy as np
import pytest

from palpate.engine.imports import full_name
from palpate.messages import Load, Surface
from palpate.physics.geometry.mesh import Mesh
from palpate.views.errors import PageError
from palpate.views.shown import Bodies

ORGAN = Mesh(np.eye(3), np.array([[0, 1, 2]]))
LINKS = [("tissue", "load", "spread"), ("spread", "contact", "contact"), ("contact", "proximity", "collision"),
         ("contact", "body", "tissue")]  # fmt: skip
STREAMS = {"tissue": ("tissue", full_name(Surface)), "spread": ("spread", full_name(Load))}


@pytest.mark.parametrize("owner", ["tissue", "spread", "collision", None])
def test_the_nearest_node_upstream_lends_its_mesh(owner):
    def mesh(node: str) -> Mesh:
        if node != owner:
            raise PageError(f"node {node!r} has no mesh")
        return ORGAN

    if owner is None:
        with pytest.raises(PageError, match="node 'tissue' has no mesh"):
            Bodies.of(LINKS, STREAMS, mesh)
        return
    found = Bodies.of(LINKS, STREAMS, mesh)
    assert list(found.streams) == ["tissue"] and found.mesh is ORGAN and found.loads == {"spread": 0}
