"""The stretch between neighbours on a surface is limited."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.bodies.stretch import StretchWorkspace, _excess, limit_stretch, neighbours

MESH = surface_mesh("kidney", 2000)
JOINED = neighbours(MESH)
SIZE = len(MESH.vertices)


def held(nodes, vectors, limit=0.8):
    place = np.full(SIZE, -1)
    place[nodes] = np.arange(len(nodes))
    shortened = np.ascontiguousarray(vectors, float).copy()
    room, least = StretchWorkspace.of(SIZE), JOINED.spans.min()
    shorter = limit_stretch(shortened, len(nodes), limit, least, JOINED, place, nodes.astype(np.int32), room)
    return shortened, shorter


def furthest(nodes, vectors):
    """Largest difference of two neighbours' displacements over their edge length, over all edges of the mesh."""
    full = np.zeros((SIZE, 3))
    full[nodes] = vectors
    sides = np.concatenate([MESH.triangles[:, [0, 1]], MESH.triangles[:, [1, 2]], MESH.triangles[:, [2, 0]]])
    i, j = sides.T
    spans = np.linalg.norm(MESH.vertices[i] - MESH.vertices[j], axis=1)
    return (np.linalg.norm(full[i] - full[j], axis=1) / spans).max()


def patch(centre, radius, pull, push):
    distance = np.linalg.norm(MESH.vertices - MESH.vertices[centre], axis=1)
    nodes = np.flatnonzero(distance < radius)
    share = (1 - (distance[nodes] / radius) ** 2) ** 2
    return nodes, share[:, None] * (np.asarray(pull) - push * MESH.normals[nodes])


lengths = st.floats(-0.03, 0.03)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, SIZE - 1), st.floats(4e-3, 15e-3), st.tuples(lengths, lengths, lengths), st.floats(0, 0.02),
    st.floats(0.3, 1.0),
)  # fmt: skip
def test_no_edge_passes_the_limit_and_every_vector_keeps_its_direction(centre, radius, pull, push, limit):
    nodes, wanted = patch(centre, radius, pull, push)
    shortened, shorter = held(nodes, wanted, limit)
    assert furthest(nodes, shortened) <= limit * (1 + 1e-6)
    before, after = np.linalg.norm(wanted, axis=1), np.linalg.norm(shortened, axis=1)
    assert (after <= before * (1 + 1e-12)).all()
    assert np.allclose(shortened * before[:, None], wanted * after[:, None], atol=1e-15)
    assert (shorter > 0) == (furthest(nodes, wanted) > limit)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, SIZE), st.floats(0.45, 1.2), st.floats(0.0, 1.0))
def test_the_largest_excess_is_that_over_all_edges(seed, count, size, spread):
    """Vectors in all directions, about as long as the limit of the shortest edge or half of it: no edge that exceeds
    the limit is left out."""
    rng, limit, shortest = np.random.default_rng(seed), 0.8, JOINED.spans.min()
    nodes = rng.choice(SIZE, count, replace=False)
    vectors = rng.normal(size=(count, 3))
    vectors *= size * limit * shortest / np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors *= rng.uniform(1.0 - spread, 1.0, (count, 1))
    place = np.full(SIZE, -1)
    place[nodes] = np.arange(count)
    room = np.full(SIZE, np.nan)
    found = _excess(vectors, count, limit, shortest, JOINED, place, nodes.astype(np.int32), room)
    assert found == pytest.approx(min(1.0, limit / furthest(nodes, vectors)), rel=1e-8)


def test_a_field_within_the_limit_is_not_changed():
    nodes, wanted = patch(10, 0.01, (1e-3, 0, 0), 1e-3)
    shortened, shorter = held(nodes, wanted)
    assert shorter == 0 and (shortened == wanted).all()


def test_a_field_with_one_direction_becomes_the_largest_within_the_limit():
    """Checked with shortest paths: each length is at most that of any other vertex plus the limit times their
    distance."""
    nodes, wanted = patch(10, 0.012, (0.03, 0, 0), 0.0)
    shortened, _ = held(nodes, wanted)
    least = np.zeros(SIZE)
    least[nodes] = wanted[:, 0]
    owner = np.repeat(np.arange(SIZE), np.diff(JOINED.first))
    for _ in range(200):
        np.minimum.at(least, owner, least[JOINED.others] + 0.8 * JOINED.spans)
    assert shortened[:, 0] == pytest.approx(least[nodes], rel=1e-6)


def test_the_result_is_independent_of_node_order_and_smooth_in_the_load():
    rng = np.random.default_rng(2)
    nodes, wanted = patch(500, 0.012, (0.02, 0.01, 0), 0.008)
    shortened, _ = held(nodes, wanted)
    order = rng.permutation(len(nodes))
    again, _ = held(nodes[order], wanted[order])
    assert again == pytest.approx(shortened[order], abs=1e-8)
    near, _ = held(nodes, 1.001 * wanted)
    assert np.abs(near - shortened).max() <= 0.0011 * np.abs(wanted).max()


def test_random_fields_are_limited():
    rng = np.random.default_rng(0)
    nodes = rng.permutation(SIZE)[:600]
    shortened, _ = held(nodes, rng.normal(size=(600, 3)))
    assert furthest(nodes, shortened) <= 0.8 * (1 + 1e-6) and np.abs(shortened).max() > 1e-4
