"""Flips of edges that remove nearly collinear triangles."""

import numpy as np
import pytest

from palpate.physics.geometry.mesh import Mesh, plane
from palpate.physics.geometry.refined.edges import directions
from palpate.physics.geometry.refined.flipped import FLAT, flip_caps
from palpate.physics.geometry.topology import edge_counts
from palpate.studies.organs.shapes import boxes, star

NONE = np.zeros((0, 2), np.int64)


LARGEST = np.arccos(FLAT)


def angles(points, triangles):
    """The largest angle [rad] (T) of each triangle, by the law of cosines."""
    a, b, c = np.sort(
        [np.linalg.norm(points[triangles[:, k]] - points[triangles[:, k - 1]], axis=1) for k in range(3)], 0
    )
    return np.arccos(np.clip((a * a + b * b - c * c) / (2.0 * a * b), -1.0, 1.0))


def with_caps(mesh, aside, every=50):
    """The mesh with a vertex `aside` [m] of the middle of some edges, in one of the two triangles there."""
    points, triangles, touched = mesh.vertices.tolist(), mesh.triangles.tolist(), set()
    across = {(a, b): n for n, t in enumerate(triangles) for a, b in zip(t, t[1:] + t[:1], strict=True)}
    for (a, b), n in list(across.items())[::every]:
        if {n, across[b, a]} & touched:
            continue
        touched |= {n, across[b, a]}
        c = next(v for v in triangles[n] if v not in (a, b))
        middle = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
        inwards = mesh.vertices[c] - middle
        points.append((middle + aside * inwards / np.linalg.norm(inwards)).tolist())
        m = len(points) - 1
        triangles[n] = [a, b, m]
        triangles += [[b, c, m], [c, a, m]]
    return Mesh(np.array(points), np.array(triangles, np.int32))


@pytest.mark.parametrize("aside", [1e-6, 1e-5, 1e-4])
def test_no_cap_remains_on_a_ball_and_the_surface_stays_closed(aside):
    ball = with_caps(star(lambda way: np.full(len(way), 0.02), 2500), aside)
    out = ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    points, given = out * 0.02, ball.triangles.astype(np.int64)
    assert (angles(points, given) > LARGEST).sum() > 50
    flipped = flip_caps(points, given, NONE)
    assert angles(points, flipped).max() < LARGEST + 1e-9 and edge_counts(flipped, len(points)) == (0, 0)
    assert (np.einsum("ij,ij->i", directions(points, flipped), out[flipped[:, 0]]) > 0.98).all()
    assert len(flipped) == len(given)


def test_the_edges_of_a_box_stay():
    box = boxes(*[(-0.01, 0.01)] * 3, np.ones((1, 1, 1), bool), 300)
    given = with_caps(box, 1e-5, every=7)
    flipped = flip_caps(given.vertices, given.triangles.astype(np.int64), NONE)
    volume = [np.linalg.det(given.vertices[t]).sum() / 6.0 for t in (given.triangles, flipped)]
    assert volume[1] == pytest.approx(0.02**3, rel=1e-9) and volume[0] == pytest.approx(0.02**3, rel=1e-9)
    assert len(np.unique(np.abs(directions(given.vertices, flipped)).round(6), axis=0)) == 3
    # on its sides they are flipped
    assert (angles(given.vertices, flipped) > LARGEST).sum() < 0.5 * (
        angles(given.vertices, given.triangles) > LARGEST
    ).sum()


def test_fixed_edges_borders_and_good_meshes_stay():
    sheet = plane(0.02, 100)
    whole = sheet.triangles.astype(np.int64)
    assert flip_caps(sheet.vertices, whole, NONE) is whole
    # a rhombus of two caps, whose long side may or may not be flipped
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0.2, 0], [0, -0.2, 0]])
    two = np.array([[0, 1, 2], [1, 0, 3]])
    assert set(map(frozenset, flip_caps(points, two, NONE).tolist())) == {frozenset({0, 2, 3}), frozenset({1, 2, 3})}
    assert flip_caps(points, two, np.array([[0, 1]])) is two
    assert flip_caps(points, two[:1], NONE) is not None and (flip_caps(points, two[:1], NONE) == two[:1]).all()


def test_a_cap_over_a_bend_stays():
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 0.1, 0], [0, 0, -1.0]])
    two = np.array([[0, 1, 2], [1, 0, 3]])
    roof = np.concatenate([two, [[1, 4, 2], [2, 4, 0]]])  # the flat part that the cap belongs to
    assert flip_caps(np.concatenate([points, [[0, 1.0, 0]]]), roof, NONE) is roof
