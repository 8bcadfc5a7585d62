"""Points that begin or cease to touch within one step of Newton's method, and the iterations that this saves."""

import numpy as np
import pytest
from pytest import approx
from scipy.sparse import csr_array

from palpate.models.fe import RigidIndenter, Solver, box, neo_hooke, sphere
from palpate.models.fe.contact.switching import Switching, join_parts, switch_points


def linear_contact(seed, count=12, points=9):
    """A positive definite matrix, forces, and points of contact about a state."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(count, count))
    rows = csr_array(rng.normal(size=(points, count)))
    own = Switching(rows, rng.normal(size=points), rng.uniform(5.0, 50.0, points), rng.uniform(0.1, 0.3, points))
    return root @ root.T + 0.1 * np.eye(count), 5.0 * rng.normal(size=count), own


def one_step(elastic, force, points):
    """Newton's step, and the step and the tractions with the active set at its end."""
    rows, level, penalty, area = points
    tangent = elastic + rows.T @ np.diag(area * penalty * (level > 0)) @ rows.toarray()
    newton = np.linalg.solve(tangent, force + rows.T @ (area * np.maximum(level, 0.0)))
    return newton, *switch_points(points, newton, lambda forces: np.linalg.solve(tangent, forces))


@pytest.mark.parametrize("seed", range(20))
def test_the_active_set_is_found_where_newton_s_method_on_it_would_cycle(seed):
    """With more points than unknowns and a stiff penalty its full steps return to former sets: in 16 of these 20."""
    elastic, force, points = linear_contact(seed, count=30, points=60)
    points = points._replace(penalty=100.0 * points.penalty)
    _, change, _ = one_step(elastic, force, points)
    right = np.maximum(points.level - points.penalty * (points.rows @ change), 0.0)
    assert np.abs(elastic @ change - force - points.rows.T @ (points.area * right)).max() < 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("seed", range(8))
def test_a_step_ends_in_balance_with_the_points_that_touch_at_its_end(seed):
    elastic, force, points = linear_contact(seed)
    rows, level, penalty, area = points
    newton, change, traction = one_step(elastic, force, points)
    right = np.maximum(level - penalty * (rows @ change), 0.0)
    assert ((level - penalty * (rows @ newton) > 0) != (level > 0)).any()  # some point switches
    assert np.abs(elastic @ change - force - rows.T @ (area * right)).max() < 1e-8 * np.abs(force).max()
    assert traction == approx(right, abs=1e-8)


def test_a_step_without_switching_is_unchanged():
    elastic, _, points = linear_contact(1)
    change, traction = switch_points(points, np.zeros(12), lambda forces: np.linalg.solve(elastic, forces))
    assert (change == 0.0).all() and traction == approx(np.maximum(points.level, 0.0))


def test_a_body_held_by_separating_points_alone_keeps_the_newton_step():
    rows = csr_array(np.array([[1.0, 0.0]]))
    points = Switching(rows, np.array([1.0]), np.array([10.0]), np.array([1.0]))
    tangent = np.diag([10.0, 1.0])  # the first component is held by the point alone
    step = np.array([0.5, 0.2])
    change, _ = switch_points(points, step, lambda forces: np.linalg.solve(tangent, forces))
    assert change == approx(step)


def test_points_of_several_contacts_are_concatenated():
    one, two = linear_contact(1)[2], linear_contact(2)[2]
    both = join_parts([one, two])
    assert both.rows.shape == (18, 12) and (both.rows[9:].toarray() == two.rows.toarray()).all()
    assert (both.level == np.concatenate([one.level, two.level])).all()


def pressed_by_a_ball(poisson, cells):
    """A ball of 4 mm goes 4 mm into a block of 20 x 20 x 10 mm that is held below."""
    mesh = box((0.02, 0.02, 0.01), (cells, cells, cells // 2))
    points = mesh.points
    top = mesh.faces[(points[mesh.faces][:, :, 2] > 0.01 - 1e-9).all(axis=1)]
    touch = RigidIndenter(top, sphere, (0.004,), lambda load: np.array([0.01, 0.01, 0.014 - 0.004 * load]))
    fixed = np.repeat(points[:, 2:] < 1e-9, 3, axis=1)
    body = Solver(mesh, {0: neo_hooke(1e4, poisson)}, fixed, contacts=[touch])
    body.advance(1.0)
    assert float(-touch.gap.min()) <= touch.bound
    return body, touch


def test_a_deep_press_of_a_ball_takes_few_iterations():
    body, touch = pressed_by_a_ball(0.3, 8)
    assert touch.force[2] == approx(-0.3569, rel=4e-3)  # with the points that touch found step by step: 62 iterations
    assert body.iterations <= 36


@pytest.mark.long
def test_a_ball_is_pressed_deep_into_a_nearly_incompressible_body():
    body, _ = pressed_by_a_ball(0.49999, 8)
    assert body.iterations <= 140  # took 710 for the first 22 % of the way
