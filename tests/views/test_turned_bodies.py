"""External renderers get a body that rotates on its foundation where it is, and another one at rest."""

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from palpate.messages import Surface
from palpate.messages.tissue import Support
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.views.carried import Carried
from palpate.views.page.feed import FINGER, FRAME, binary, frame, surface_frame, vertices_of


def test_displacements_of_a_body_that_rotates_are_those_of_all_its_vertices_in_the_world():
    flat, count = plane(0.1, 25), 25
    one, other = flat.vertices, flat.vertices + [0.0, 0.0, 0.2]
    mesh = Mesh(np.vstack([one, other]), np.vstack([flat.triangles, flat.triangles + count]).astype(np.int32))
    count = len(one)
    nodes, bulge = np.array([3, 7, count + 2], np.int32), np.random.default_rng(1).normal(0.0, 1e-3, (3, 3))
    surface = msgspec.structs.replace(Surface.example(True), nodes=nodes, displacement=bulge, pressure=np.arange(3.0))
    r, d, c = np.array([0.3, -0.2, 0.5]), (1e-3, 2e-3, 3e-3), np.array([0.01, 0.02, 0.0])
    by = Carried.by(Support(displacement=d, velocity=(0.0, 0.0, 0.0), rotation=r, spin=np.zeros(3), centre=c))
    still = {"load": 0.0, "depth": 0.0, "squeeze": 0.0, "foot": (0, 0, 0), "normal": (0, 0, 1)}
    head = {"kind": "frame", "late": 0, "time": 0.0, "others": [], "carried": [(0, count, by.way, by.turn)], **still}
    data = binary(frame(head, surface), vertices_of(surface_frame(mesh, {"fingers": ["contact"]})))
    begin, number = FRAME.size + FINGER.size, count + 1
    assert np.frombuffer(data, "<u4", number, begin).tolist() == [*range(count), count + 2]
    field = np.frombuffer(data, "<f4", 3 * number, begin + 4 * number).reshape(-1, 3)
    moved = one.copy()
    moved[[3, 7]] += bulge[:2]
    want = Rotation.from_rotvec(r).apply(moved - c) + c + d - one
    np.testing.assert_allclose(field[:count], want, atol=1e-7)
    np.testing.assert_allclose(field[count], bulge[2], atol=1e-9)
