"""The tree of a mesh, whose nodes halve their triangles, and which of equally near triangles a search finds."""

import numpy as np
import pytest

from palpate.physics.geometry.mesh_closest import MeshClosestPoint, _disc, _on_triangle
from palpate.physics.geometry.search.halves import halved_order
from palpate.studies.organs.shapes import boxes, star


@pytest.mark.parametrize("count, leaves", [(1, 1), (3, 1), (7, 2), (100, 32), (1000, 256), (1025, 512)])
@pytest.mark.parametrize("kind", ["random", "grid", "line", "equal"])
def test_each_node_halves_its_points_across_their_longest_side(count, leaves, kind):
    points = np.random.default_rng(count).uniform(size=(count, 3)) * (1.0, 2.0, 0.5)
    if kind == "grid":
        points = np.round(4.0 * points)
    elif kind in ("line", "equal"):
        points[:, kind == "line" :] = 0.3
    order = halved_order(points, leaves)
    assert sorted(order.tolist()) == list(range(count)) and order[0] == 0
    for node in range(1, leaves):
        row = leaves >> (node.bit_length() - 1)
        first = node * row - leaves
        begin, middle, end = ((first + part) * count // leaves for part in (0, row // 2, row))
        if begin < middle < end:
            inside = points[order[begin:end]]
            axis = np.ptp(inside, axis=0).argmax()
            low, high = np.sort(points[order[begin:middle], axis]), np.sort(points[order[middle:end], axis])
            spare = int(begin == 0)  # where point 0 is in the middle, another one takes its place
            if spare and low[-1] > high[0]:
                low, high = high, low
            assert low[-1 - spare * (len(low) > 1)] <= high[spare * (len(high) > 1)]


def first_of_nearest(closest, p):
    """The nearest triangle that a depth-first search of the Morton tree finds first, the nearer node first."""
    tables = closest.tables
    count, leaves = len(tables.cells), len(tables.discs) // 4
    bounds, cells = tables.discs[2 * leaves :], np.argsort(tables.cells["rank"])
    away = np.array([_on_triangle(tables.points, tables.cells, t, *p)[0] for t in cells])

    def visit(node):
        if node >= leaves:
            yield from range((node - leaves) * count // leaves, (node - leaves + 1) * count // leaves)
            return
        left = _disc(bounds[2 * node], *p) <= _disc(bounds[2 * node + 1], *p)
        for child in (2 * node + 1 - left, 2 * node + left):
            yield from visit(child)

    return tables.cells["origin"][cells[next(t for t in visit(1) if away[t] == away.min())]], away.min()


@pytest.mark.parametrize("make", [
    lambda: boxes((-0.02, 0.02), (-0.02, 0.02), (-0.01, 0.01), np.ones((1, 1, 1), bool), 200),
    lambda: star(lambda unit: np.full(len(unit), 0.02), 200),
])  # fmt: skip
def test_of_equally_near_triangles_the_first_on_the_morton_tree_counts(make):
    """At vertices, beyond them, and on planes of symmetry."""
    body = make()
    closest = MeshClosestPoint(body)
    points = [body.vertices, 1.5 * body.vertices, 0.5 * body.vertices, np.random.default_rng(1).normal(size=(50, 3))]
    found, several = np.concatenate([each[:60] for each in points]), 0
    _, _, triangle, distance = closest.find(found)
    seed = closest.tables.cells["origin"][0]
    for p, t, away in zip(found, triangle, distance, strict=True):
        first, least = first_of_nearest(closest, p)
        assert away == pytest.approx(np.copysign(np.sqrt(least), away), rel=1e-12, abs=1e-15)
        assert t in (first, seed)  # a search begins at the seed
        several += t == first
    assert several > 0.9 * len(found)
