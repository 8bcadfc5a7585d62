"""The page shows a body that rotates on its foundation where it is, and another one at rest."""

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from palpate.messages import Surface
from palpate.messages.tissue import Support
from palpate.physics.geometry.mesh import plane
from palpate.views.carried import Carried
from palpate.views.page.feed import _turned


def test_displacements_of_a_body_that_rotates_are_those_of_all_its_vertices_in_the_world():
    one, other = plane(0.1, 25).vertices, plane(0.1, 36).vertices + [0.0, 0.0, 0.2]
    vertices, count = np.vstack([one, other]), len(one)
    rng = np.random.default_rng(1)
    nodes = np.array([3, 7, count + 2], np.int32)
    bulge = rng.normal(0.0, 1e-3, (3, 3))
    surface = msgspec.structs.replace(Surface.example(True), nodes=nodes, displacement=bulge, pressure=np.arange(3.0))
    r, d, c = np.array([0.3, -0.2, 0.5]), (1e-3, 2e-3, 3e-3), np.array([0.01, 0.02, 0.0])
    by = Carried.by(Support(displacement=d, velocity=(0.0, 0.0, 0.0), rotation=r, spin=np.zeros(3), centre=c))
    shown = _turned(surface, vertices, [(0, count, by)])
    assert shown.nodes.tolist() == [*range(count), count + 2]
    moved = one.copy()
    moved[[3, 7]] += bulge[:2]
    want = Rotation.from_rotvec(r).apply(moved - c) + c + d - one
    np.testing.assert_allclose(shown.displacement[:count], want, atol=1e-12)
    np.testing.assert_array_equal(shown.displacement[count], bulge[2])
    assert shown.pressure[[3, 7, count]].tolist() == [0.0, 1.0, 2.0] and shown.pressure.sum() == 3.0
