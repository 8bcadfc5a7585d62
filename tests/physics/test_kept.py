"""The cache of results for arrays with the same content."""

import numpy as np

from palpate.nodes.base.surface import surface_patch
from palpate.physics import kept
from palpate.physics.geometry.graded import ranges
from palpate.physics.geometry.search.samples import samples_of
from palpate.physics.kept import KEPT


def test_equal_contents_give_the_cached_result_and_others_a_new_one():
    calls = []

    @kept.keep_results
    def summed(points, more):
        calls.append(more)
        return points.sum(axis=0) + more

    points = np.arange(6.0).reshape(2, 3)
    first = summed(points, 1.0)
    assert summed(points.copy(), 1.0) is first and calls == [1.0]
    assert (first == points.sum(axis=0) + 1.0).all()
    points[0, 0] = 7.0  # the same array with other contents
    assert summed(points, 1.0)[0] == 11.0
    for other in (points.reshape(3, 2), points.view(np.int64), points.astype(np.float32)):
        assert (summed(other, 1.0) == other.sum(axis=0) + 1.0).all()
    assert len(calls) == 5


def test_the_oldest_entry_is_removed_from_a_full_cache():
    calls = []

    @kept.keep_results
    def same(points):
        calls.append(len(points))
        return points

    for size in (*range(KEPT + 1), *range(1, KEPT + 1), 0):
        same(np.zeros(size))
    assert calls == [*range(KEPT + 1), 0]


def test_a_mesh_is_ranked_once():
    points = np.random.default_rng(1).uniform(size=(500, 3))
    assert ranges(points, 0.1) is ranges(points.copy(), 0.1)
    assert ranges(points, 0.2) is not ranges(points, 0.1)


def test_a_smooth_surface_is_sampled_once_for_all_users():
    first, again, away = (surface_patch("kidney", (0.0, 0.0, z), (0.0, 0.0, 0.0)) for z in (0.0, 0.0, 0.01))
    assert first is not again and samples_of(first, 500) is samples_of(again, 500)
    assert (samples_of(away, 500).samples["point"] != samples_of(first, 500).samples["point"]).any()
    assert len(samples_of(first, 2000).samples) > len(samples_of(first, 500).samples)
