"""The sent part of a finer mesh: vertices, displacement and pressure, compared with whole arrays."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.bodies.patch import MOST_FEET, NEAR, add_pressure, interpolate_fine, listed, reaches


@pytest.mark.parametrize("count", [1, 7, 8, 9, 250])
def test_vertices_near_the_contact_are_sent_in_order_with_the_mean_of_their_corners(count):
    rng = np.random.default_rng(count)
    vertices, within = rng.random((count, 3)), rng.choice([0.2, 0.5, np.inf], count)
    corners, weights = rng.integers(0, 40, (count, 3)), rng.dirichlet(np.ones(3), count)
    u, feet = rng.normal(size=(40, 3)), np.array([(0.4, 0.5, 0.6), (0.9, 0.1, 0.4)])
    rows, room = reaches(vertices, within), listed(count)
    nodes, moved = np.zeros(count, dtype=np.int32), np.zeros((count, 3))
    for _ in range(2):
        printed = interpolate_fine(corners, weights, u, rows, feet, room, nodes, moved)
    away = np.linalg.norm(vertices[:, None] - feet, axis=2)
    right = np.flatnonzero((away <= within[:, None]).any(axis=1))
    assert nodes[:printed].tolist() == right.tolist()
    assert moved[:printed] == approx(np.einsum("ka,kai->ki", weights[right], u[corners[right]]))


@pytest.mark.parametrize("fingers", [1, 2, MOST_FEET, MOST_FEET + 1])
def test_the_list_of_vertices_that_may_be_sent_changes_nothing_while_feet_move(fingers):
    """Feet that creep, rest, jump, and change their number; compared with all vertices in single precision."""
    rng, count, listings = np.random.default_rng(fingers), 3000, set()
    vertices, within = 0.05 * rng.random((count, 3)), rng.uniform(0.0, 0.01, count)
    rows, room, u = reaches(vertices, within), listed(count), np.ones((1, 3))
    corners, weights = np.zeros((count, 3), np.int64), np.full((count, 3), 1.0 / 3.0)
    nodes, moved = np.zeros(count, np.int32), np.zeros((count, 3))
    feet = 0.05 * rng.random((fingers, 3))
    for step in range(300):
        feet = feet + rng.normal(size=feet.shape) * rng.choice([0.0, 0.02, 0.2, 3.0]) * NEAR
        given = feet[: max(1, fingers - step % 50 // 45)]
        sent = interpolate_fine(corners, weights, u, rows, given, room, nodes, moved)
        apart = rows[:3, :, None] - given.T.astype(np.float32)[:, None]
        square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2]
        assert nodes[:sent].tolist() == np.flatnonzero((square <= rows[3][:, None]).any(axis=1)).tolist()
        listings.add(room.feet.tobytes())
    assert len(listings) > 10 and (len(listings) < 250 or fingers > MOST_FEET)


def test_pressure_is_the_normal_force_over_the_area_and_accumulates():
    rng = np.random.default_rng(2)
    pull, patch, areas = rng.normal(size=(12, 3)), rng.choice(60, 12, replace=False).astype(np.int32), rng.random(60)
    normal, printed, push = (0.6, 0.0, 0.8), np.arange(0, 60, 2, dtype=np.int32), np.zeros(60)
    out = np.full(len(printed), 3.0)
    add_pressure(pull, patch, normal, areas, printed, push, out)
    right = np.full(60, 3.0)
    right[patch] -= (pull @ normal) / areas[patch]
    assert out == approx(right[printed]) and (out != 3.0).any() and not push.any()
