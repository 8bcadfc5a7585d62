"""Distance queries that end early give the answers of complete ones."""

import numpy as np
import pytest

from palpate.physics.geometry.felt.hollow import Hollow
from palpate.physics.geometry.felt.in_ball import SLACK
from palpate.physics.geometry.felt.touchable import divide_long_edges, hides, untouchable
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.organs.shapes import boxes, star

R = 8e-3  # [m]


def bumpy():
    """A ball with hollows and bumps."""
    return star(lambda u: 0.03 + 0.004 * np.sin(9.0 * u[:, 0]) * np.cos(7.0 * u[:, 1] + 2.0 * u[:, 2]), 4000)


def grooved():
    """A block with a groove of 6 mm."""
    full = np.ones((1, 3, 2), bool)
    full[0, 1, 1] = False
    return boxes((-0.02, 0.02), (-0.02, -0.003, 0.003, 0.02), (-0.012, 0.0, 0.01), full, 3000)


def many(kind, seed=0):
    """Points in a sphere: near each other in turn, or in a random order, with repetitions."""
    points = np.random.default_rng(seed).uniform(-0.06, 0.06, size=(3000, 3))
    points = points if kind == "random" else points[np.lexsort(np.round(points / 0.02).T)]
    return np.concatenate([points, points[:100]])


@pytest.mark.parametrize("order", ["random", "sorted"])
@pytest.mark.parametrize("make", [bumpy, grooved])
def test_the_farthest_of_points_and_those_beyond_a_distance(make, order):
    closest, points = MeshClosestPoint(make()), many(order)
    away = np.abs(closest.find(points)[3])
    farthest, which = closest.farthest(points)
    assert farthest == pytest.approx(away.max(), rel=1e-12) and which == away.argmax()
    inside = points[away < 0.01]
    farthest, which = closest.farthest(inside)
    assert farthest == pytest.approx(away[away < 0.01].max(), rel=1e-12) and which == away[away < 0.01].argmax()
    for distance in (0.0, 1e-4, 3e-3, 0.02, 0.2):
        np.testing.assert_array_equal(closest.beyond(points, distance), away > distance)
    on = closest.find(points)[0]
    assert closest.farthest(on)[0] < 1e-15 and not closest.beyond(on, 1e-9).any()


def test_points_near_triangles_that_a_ball_cannot_touch():
    body = grooved()
    closest = MeshClosestPoint(body)
    hollow = Hollow(Mesh(body.vertices, body.triangles[untouchable(body, closest, R)]))
    for order in ("random", "sorted"):
        points = many(order, 1)
        for most in (0.0, 1e-3, 0.01, 0.05):
            near = hollow.within(points, most)
            np.testing.assert_array_equal(near, hollow.about(points, most) <= most)
        assert near.any() and not near.all()


@pytest.mark.parametrize("make", [bumpy, grooved])
def test_a_ball_is_hidden_where_the_body_is_inside_it(make):
    """By the distance of the centre of each ball from the whole body."""
    body = make()
    fine, _ = divide_long_edges(body, R / 3.0)
    closest, size = MeshClosestPoint(body), np.linalg.norm(fine.face_vectors, axis=1)
    middle = fine.vertices[fine.triangles].mean(axis=1)
    normal = fine.face_vectors / size[:, None]
    away = closest.find(middle + R * normal)[3]
    sure = np.abs(away - (R - SLACK)) > 1e-9
    hidden = hides(closest, middle, normal, R)
    np.testing.assert_array_equal(hidden[sure], (away < R - SLACK)[sure])
    np.testing.assert_array_equal(hidden, untouchable(fine, closest, R))
    assert 0.02 < hidden.mean() < 0.9 and sure.mean() > 0.99
    turned = np.random.default_rng(2).permutation(len(middle))  # neighbours are not next to each other
    np.testing.assert_array_equal(hides(closest, middle[turned], normal[turned], R), hidden[turned])


def test_sorted_points_have_the_same_distances():
    """Of equally near places either may be found."""
    closest, points = MeshClosestPoint(bumpy()), many("random")
    foot, _, triangle, distance = closest.find_sorted(points)
    np.testing.assert_allclose(distance, closest.find(points)[3], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), np.abs(distance), rtol=1e-12, atol=1e-15)
    of_each = [MeshClosestPoint(Mesh(bumpy().vertices, bumpy().triangles[t : t + 1])) for t in triangle[:50].tolist()]
    on = [np.linalg.norm(each.find(at)[0] - at) for each, at in zip(of_each, foot[:50], strict=True)]
    assert max(on) < 1e-15


def test_only_edges_within_a_part_are_divided():
    """All edges of the part are short, no other one changes, and the area remains."""
    body = bumpy()
    part = body.vertices[:, 2] > 0.0
    longest = 0.4 * float(
        np.linalg.norm(body.vertices[body.triangles[:, 0]] - body.vertices[body.triangles[:, 1]], axis=1).max()
    )
    fine, origin = divide_long_edges(body, longest, part)
    inside = np.concatenate([part, np.ones(len(fine.vertices) - len(part), bool)])
    ends, _ = fine.edges
    length = np.linalg.norm(fine.vertices[ends[:, 0]] - fine.vertices[ends[:, 1]], axis=1)
    assert length[inside[ends].all(axis=1)].max() <= longest < length.max()
    before = {tuple(edge) for edge in body.edges[0][~part[body.edges[0]].all(axis=1)].tolist()}
    assert before <= {tuple(edge) for edge in ends.tolist()}
    assert len(fine.triangles) > len(body.triangles) and fine.closed
    areas = [np.linalg.norm(each.face_vectors, axis=1) for each in (fine, body)]
    np.testing.assert_allclose(np.bincount(origin, areas[0]), areas[1], rtol=1e-9)
