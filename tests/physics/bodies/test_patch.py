"""The sent part of a finer mesh: vertices, displacement and pressure, compared with whole arrays."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.bodies.patch import add_pressure, interpolate_fine, reaches


@pytest.mark.parametrize("count", [1, 7, 8, 9, 250])
def test_vertices_near_the_contact_are_sent_in_order_with_the_mean_of_their_corners(count):
    rng = np.random.default_rng(count)
    vertices, within = rng.random((count, 3)), rng.choice([0.2, 0.5, np.inf], count)
    corners, weights = rng.integers(0, 40, (count, 3)), rng.dirichlet(np.ones(3), count)
    u, feet = rng.normal(size=(40, 3)), np.array([(0.4, 0.5, 0.6), (0.9, 0.1, 0.4)])
    rows, room = reaches(vertices, within)
    nodes, moved = np.zeros(count, dtype=np.int32), np.zeros((count, 3))
    for _ in range(2):
        printed = interpolate_fine(corners, weights, u, rows, feet, room, nodes, moved)
    away = np.linalg.norm(vertices[:, None] - feet, axis=2)
    right = np.flatnonzero((away <= within[:, None]).any(axis=1))
    assert nodes[:printed].tolist() == right.tolist()
    assert moved[:printed] == approx(np.einsum("ka,kai->ki", weights[right], u[corners[right]]))


def test_pressure_is_the_normal_force_over_the_area_and_accumulates():
    rng = np.random.default_rng(2)
    pull, patch, areas = rng.normal(size=(12, 3)), rng.choice(60, 12, replace=False).astype(np.int32), rng.random(60)
    normal, printed, push = (0.6, 0.0, 0.8), np.arange(0, 60, 2, dtype=np.int32), np.zeros(60)
    out = np.full(len(printed), 3.0)
    add_pressure(pull, patch, normal, areas, printed, push, out)
    right = np.full(60, 3.0)
    right[patch] -= (pull @ normal) / areas[patch]
    assert out == approx(right[printed]) and (out != 3.0).any() and not push.any()
