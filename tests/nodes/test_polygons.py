"""Polygons of mesh files: a prism over any simple polygon is the same body as its polygon says."""

import numpy as np
import pytest
from polygon_files import (
    L_SHAPE,
    SHAPES,
    any_plane,
    area_of,
    as_obj,
    as_ply,
    is_inside,
    polygon,
    prism,
)

import palpate
from palpate.launch.testing import FakeBus
from palpate.messages import Pose
from palpate.nodes.base.mesh_file import flaws, read_mesh
from palpate.nodes.base.mesh_formats import polygons, read_file
from palpate.nodes.base.mesh_formats.polygons import FileMesh, triangulate
from palpate.nodes.collision import Mesh as MeshNode
from palpate.physics.geometry.crossing import crossing
from palpate.physics.geometry.mesh import Mesh, write_ply

HEIGHT = 30.0
WRITE = {
    ".obj": as_obj,
    " text.ply": as_ply,
    ".ply": lambda p, f: as_ply(p, f, "binary_little_endian"),
    " big.ply": lambda p, f: as_ply(p, f, "binary_big_endian"),
}


def solid_angle_inside(points, triangles, at):
    """Whether points (m,3) are inside of a closed surface, by the sum of the solid angles."""
    a, b, c = (points[triangles[:, i]][None] - at[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    dots = [np.einsum("mti,mti->mt", p, q) for p, q in ((a, b), (b, c), (c, a))]
    under = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return np.arctan2(np.einsum("mti,mti->mt", a, np.cross(b, c)), under).sum(axis=1) / (2 * np.pi) > 0.5


def is_closed(triangles):
    """Whether each edge has two triangles of one orientation."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward, back = np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0)
    return len(forward) == len(edges) and np.array_equal(forward, back)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("uneven", [0.0, 1e-3])
def test_a_prism_over_any_simple_polygon_is_read_as_its_polygon_says(tmp_path, shape, uneven):
    """150 prisms each: area by the shoelace formula, inside and outside of 40 points by crossings of a ray."""
    worst = 0.0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        corners = polygon(rng, shape)
        flat, faces = prism(corners, HEIGHT)
        points, turn, shift = any_plane(rng, flat, uneven)
        name = list(WRITE)[seed % len(WRITE)]
        (tmp_path / f"prism{name}").write_bytes(WRITE[name](points, faces))
        vertices, triangles, notes, _ = read_file(str(tmp_path / f"prism{name}"))
        assert notes == [] and len(vertices) == len(points) and is_closed(triangles)
        around = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum()
        area = 0.5 * np.linalg.norm(Mesh(vertices, triangles).face_vectors, axis=1).sum()
        worst = max(worst, abs(area / (2.0 * area_of(corners) + around * HEIGHT) - 1.0))
        low, high = corners.min(axis=0) - 5.0, corners.max(axis=0) + 5.0
        at = np.column_stack([rng.uniform(low, high, (40, 2)), rng.uniform(-0.2, 1.2, 40) * HEIGHT])
        expected = is_inside(corners, at[:, :2]) & (at[:, 2] > 0.0) & (at[:, 2] < HEIGHT)
        sides = corners, np.roll(corners, -1, axis=0)
        clear = distance(sides, at[:, :2]) > 0.01  # uneven sides bulge
        found = solid_angle_inside(vertices, triangles, turn.apply(at) + shift)
        np.testing.assert_array_equal(found[clear], expected[clear])
        if seed % 10 == 0:
            assert crossing(vertices, triangles) is None
    assert worst < (1e-9 if uneven == 0.0 else 1e-3)


def distance(sides, points):
    """Of points (m,2) from the sides of a polygon."""
    a, b = sides
    along = b - a
    share = np.clip(np.einsum("mki,ki->mk", points[:, None] - a, along) / (along**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - share[:, :, None] * along, axis=2).min(axis=1)


@pytest.mark.parametrize("start", range(6))
@pytest.mark.parametrize("name", WRITE)
def test_a_finger_in_the_notch_of_an_l_shaped_body_touches_nothing(tmp_path, name, start):
    """The finger is 13 mm from both arms; a fan of each hexagon from some corners would cover the notch."""
    points, faces = prism(np.roll(L_SHAPE, start, axis=0), HEIGHT)
    file = tmp_path / f"L{name}"
    file.write_bytes(WRITE[name](points, faces))
    assert flaws(str(file)) == []
    mesh = read_mesh(str(file), 1e-3)
    assert mesh.areas.sum() == pytest.approx(2 * 2000e-6 + 240e-3 * 30e-3, rel=1e-12)
    bus = FakeBus(MeshNode(surface=str(file), file_unit="mm", position=(0.0, 0.0, 0.0), width=0.0, refine=4e-3))
    down = [Pose(position=(0.033, 0.033, z), velocity=(0.0, 0.0, 0.0), dt=1e-3) for z in np.linspace(0.06, 0.015, 200)]
    gaps = np.array([answer.gap for answer in bus.publish(*down)])
    assert gaps[-1] == pytest.approx(0.013, abs=1e-6) and gaps.min() > 0.0129


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_a_hand_that_moves_down_in_the_notch_feels_no_force(tmp_path):
    """Cut as a fan from this corner, the L pushes it with 5 N."""
    points, faces = prism(np.roll(L_SHAPE, 1, axis=0), HEIGHT)
    (tmp_path / "L.obj").write_bytes(as_obj(points, faces))
    surface = {"surface": str(tmp_path / "L.obj"), "file_unit": "mm", "position": [-0.033, -0.033, 0.068]}
    hand = {"begin": [0.0, 0.0, 0.116], "path": [{"to": [0.0, 0.0, 0.088], "time": 0.15}]}
    sets = {f"scene.surface.{name}": value for name, value in surface.items()}
    sets |= {f"scene.hand.{name}": value for name, value in hand.items()}
    run = palpate.run("kidney", record=None, duration=0.15, collision="collision.Mesh", sets=sets)
    assert np.min(run.collision.gap) > 0.0129
    assert np.max(np.abs(run.contact.force)) == 0.0


def test_triangles_that_overlap_in_one_plane_are_reported(tmp_path):
    """The L as other programs write it: each hexagon as a fan, which folds at four of its six corners."""
    folded = 0
    for start in range(6):
        corners = np.roll(L_SHAPE, start, axis=0)
        points, faces = prism(corners, HEIGHT)
        fan = [[face[0], face[k], face[k + 1]] for face in faces for k in range(1, len(face) - 1)]
        area = 0.5 * np.linalg.norm(Mesh(points, np.array(fan)).face_vectors, axis=1).sum()
        right = area == pytest.approx(2 * 2000.0 + 240.0 * 30.0)
        file = tmp_path / f"{start}.ply"
        write_ply(file, Mesh(points.astype(np.float32).astype(float), np.array(fan, np.int32)))
        assert any("intersects itself" in line for line in flaws(str(file))) == (not right)
        folded += not right
    assert folded >= 4


def test_overlaps_are_found_at_any_rotation_and_faces_of_two_bodies_are_none():
    points, faces = prism(np.roll(L_SHAPE, 1, axis=0), HEIGHT)
    fan = np.array([[face[0], face[k], face[k + 1]] for face in faces for k in range(1, len(face) - 1)])
    _, right = points, triangulate(FileMesh(points, np.concatenate(faces), np.array([len(f) for f in faces])))[0]
    for seed in range(50):
        turned, _, _ = any_plane(np.random.default_rng(seed), points)
        for rounded in (turned, turned.astype(np.float32).astype(float)):
            assert crossing(rounded, fan) is not None
            assert crossing(rounded, right) is None
    above = np.concatenate([points, points + (0.0, 0.0, HEIGHT)])
    assert crossing(above, np.concatenate([right, right + len(points)])) is None


def test_polygons_whose_sides_cross_or_that_are_degenerate_are_counted():
    square = np.array([(0, 0, 0), (1, 0, 0), (2, 2, 0), (0, 1, 0)], float)
    bow = FileMesh(square, np.array([0, 2, 1, 3, 0, 1]), np.array([4, 2]))
    triangles, notes = triangulate(bow)
    assert triangles.shape == (2, 3)
    assert notes == [
        "1 of its 2 faces have fewer than three corners and are left out", "the sides of 1 of its 2 polygons cross",
    ]  # fmt: skip
    for corners in ([0, 0, 1, 2], [0, 1, 2, 2], [0, 1, 0, 1, 0]):
        triangles, _ = triangulate(FileMesh(square, np.array(corners), np.array([len(corners)])))
        assert triangles.shape == (len(corners) - 2, 3)
    nothing = FileMesh(np.full((4, 3), np.nan), np.arange(4), np.array([4]))
    assert triangulate(nothing)[0].shape == (2, 3)


def test_a_polygon_of_too_many_corners_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(polygons, "MOST_CORNERS", 5)
    points, faces = prism(L_SHAPE, HEIGHT)
    (tmp_path / "L.obj").write_bytes(as_obj(points, faces))
    with pytest.raises(Exception, match="not convex has 6 corners, expected at most 5"):
        read_file(str(tmp_path / "L.obj"))
    around = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    points, faces = prism(np.stack([np.cos(around), np.sin(around)], axis=1), 1.0)
    (tmp_path / "rod.obj").write_bytes(as_obj(points, faces))
    assert len(read_file(str(tmp_path / "rod.obj"))[1]) == 2 * 38 + 2 * 40  # convex: no limit


def test_without_manifold_a_convex_body_is_read_and_the_error_of_another_names_the_package(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "manifold3d", None)
    for name, corners in (("box", L_SHAPE[[0, 1, 2]]), ("L", L_SHAPE)):
        points, faces = prism(corners, HEIGHT)
        (tmp_path / f"{name}.obj").write_bytes(as_obj(points, faces))
    assert len(read_file(str(tmp_path / "box.obj"))[1]) == 8
    with pytest.raises(Exception, match=r"manifold3d.*palpate\[mesh\]"):
        read_file(str(tmp_path / "L.obj"))
