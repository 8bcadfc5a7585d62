"""Rigid indenters: their shapes, and what changes when they turn."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import (
    ConvergenceError,
    RigidIndenter,
    Settings,
    Solver,
    box,
    capsule,
    neo_hooke,
    plane,
    sphere,
)

SOFT = neo_hooke(1e4, 0.3)


def turned(axis, angle):
    """Rotation about an axis; Rodrigues."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def pressed(shape, parameters, path, cells=(3, 3, 2), friction=0.0, held=None):
    """A block of 1 by 1 by 0.5 m, clamped below, its top face free to touch."""
    mesh = box((1.0, 1.0, 0.5), cells)
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > 0.5 - 1e-9).all(axis=1)]
    touch = RigidIndenter(top, shape, parameters, path, friction)
    return Solver(mesh, {0: SOFT}, fixed, held, contacts=[touch]), touch


SHAPES = {
    "plane": lambda: (plane, (0.6, 0.0, 0.8)),
    "sphere": lambda: (sphere, (1.0,)),
    "capsule": lambda: (capsule, (0.4, 0.7)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_gives_the_derivatives_of_its_distance(name):
    shape, parameters = SHAPES[name]()
    rng, p, h = np.random.default_rng(4), np.array(parameters), 1e-6

    def at(x):
        normal, curvature = np.zeros(3), np.zeros((3, 3))
        return shape(x, p, normal, curvature), normal, curvature

    for x in rng.uniform(-1.1, 1.1, (20, 3)):
        _, normal, curvature = at(x)
        ends = [(at(x + h * e), at(x - h * e)) for e in np.eye(3)]
        assert normal == approx([(a[0] - b[0]) / (2 * h) for a, b in ends], abs=1e-6)
        assert curvature == approx(np.array([(a[1] - b[1]) / (2 * h) for a, b in ends]), abs=1e-4)


def test_turning_everything_together_changes_nothing_but_the_direction():
    axis, end = (0.3, -0.5, 0.8), 1.2
    mesh = box((1.0, 1.0, 0.5), (2, 2, 1))

    def path(load):
        turn = turned(axis, end * max(load - 1.0, 0.0))
        return turn @ (0.1, 0.0, 0.5 - 0.08 * min(load, 1.0)), turn

    def held(load):
        return mesh.points @ path(load)[1].T - mesh.points

    body, touch = pressed(plane, (0.0, 0.0, -1.0), path, (2, 2, 1), 0.3, held)
    body.advance(1.0)
    force, moment, u = touch.force, touch.moment, body.displacement
    body.advance(2.0)
    turn = path(2.0)[1]
    size = np.linalg.norm(force)
    assert touch.force == approx(turn @ force, abs=1e-3 * size)
    assert touch.moment == approx(turn @ moment, abs=1e-3 * size)
    assert body.displacement == approx((mesh.points + u) @ turn.T - mesh.points, abs=2e-4)


def test_a_plate_that_turns_on_a_block_drags_every_point_against_its_motion():
    def path(load):
        return np.array([0.5, 0.5, 0.5 - 0.03 * min(load, 1.0)]), turned((0, 0, 1), 0.8 * max(load - 1.0, 0.0))

    body, touch = pressed(plane, (0.0, 0.0, -1.0), path, friction=0.2)
    body.advance(1.0)
    assert abs(touch.moment[2]) < 1e-3 * np.linalg.norm(touch.force)
    body.advance(2.0)
    assert touch.slip[touch.traction > 0].mean() > 0.9
    place = np.einsum("qa,fai->fqi", touch.value, (body.mesh.points + body.displacement)[touch.faces])
    arm = np.linalg.norm(place[..., :2] - 0.5, axis=2)
    assert touch.moment[2] == approx(0.2 * np.sum(touch.area * touch.traction * arm), rel=0.02)
    assert body.reaction.sum(axis=0) == approx(-touch.force, abs=1e-4 * np.linalg.norm(touch.force))


def test_a_ball_that_rolls_is_dragged_far_less_than_one_that_slides():
    def moved(spin):
        def path(load):
            far = 0.06 * max(load - 1.0, 0.0)
            return np.array([0.45 + far, 0.5, 1.0 - 0.06 * min(load, 1.0)]), turned((0, 1, 0), spin * far / 0.5)

        body, touch = pressed(sphere, (0.5,), path, (4, 4, 2), 0.4)
        body.advance(2.0)
        return touch.force[0] / abs(touch.force[2])

    sliding, rolling = moved(0.0), moved(1.0)
    assert sliding == approx(0.4, abs=0.03)
    assert abs(rolling) < 0.25 * sliding


def test_an_invalid_path_is_an_error_with_its_load():
    for wrong, text in (
        (lambda load: np.zeros(2), r"expected a position"),
        (lambda load: np.full(3, np.nan), r"path at load 0: .*all finite"),
        (lambda load: (np.zeros(3), 2.0 * np.eye(3)), "is not a rotation"),
        (lambda load: (np.zeros(3), -np.eye(3)), "is not a rotation"),
    ):
        body, _ = pressed(plane, (0.0, 0.0, -1.0), wrong)
        with pytest.raises(ValueError, match=text):
            body.advance(1.0)


def test_steps_of_the_load_hardly_change_what_friction_gives():
    def path(load):
        return np.array([0.45 + 0.05 * load, 0.5, 1.0 - 0.06 * load])

    def forces(step):
        body, touch = pressed(sphere, (0.5,), path, (4, 4, 2), 0.3)
        body.settings = Settings(step=step, largest=step)
        body.advance(1.0)
        return touch.force

    few, many = forces(0.25), forces(0.0625)
    assert few[2] == approx(many[2], rel=0.01)
    assert few[0] == approx(many[0], rel=0.1)


def test_a_step_does_not_carry_an_indenter_through_the_body():
    mesh = box((1.0, 1.0, 0.5), (3, 3, 2))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    touch = RigidIndenter(mesh.faces[~(mesh.points[mesh.faces][:, :, 2] < 1e-9).all(axis=1)], sphere, (0.25,),
                  lambda load: np.array([0.5, 0.5, 0.8 - 3.0 * load]))  # fmt: skip
    body = Solver(mesh, {0: SOFT}, fixed, contacts=[touch], settings=Settings(step=0.5, largest=0.5, least=0.005))
    with pytest.raises(ConvergenceError):
        body.advance(1.0)
    deep = 3.0 * body.load - 0.05  # of the ball's lowest point below the top face
    assert 0.0 < deep < 0.5 and touch.touches() and touch.force[2] < 0.0
    assert body.displacement[:, 2].min() == approx(-deep, rel=0.1)


def test_an_error_of_a_too_long_step_names_the_load_where_the_indenter_would_pass():
    mesh = box((1.0, 1.0, 0.5), (3, 3, 2))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    steps = Settings(step=1.0, largest=1.0, least=0.9)
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > 0.5 - 1e-9).all(axis=1)]
    start = np.array([0.5, 0.5, 0.7])
    for end, through in (((0.5, 0.5, -1.0), True), ((0.5, 0.5, 2.0), False), ((3.0, 0.5, 0.7), False)):
        touch = RigidIndenter(top, sphere, (0.1,), lambda load, end=end: start + load * (np.array(end) - start))
        body = Solver(mesh, {0: SOFT}, fixed, contacts=[touch], settings=steps)
        if through:
            with pytest.raises(ConvergenceError, match=r"passes through the surface at \(0\.\d+, 0\.\d+, 0\.5\) m"):
                body.advance(1.0)
        else:
            body.advance(1.0)
        assert body.load == (0.0 if through else 1.0)
        assert not body.displacement.any()


def test_a_long_slide_is_not_an_error_of_a_too_long_step():
    body, touch = pressed(
        sphere, (0.3,), lambda load: np.array([0.4 + 0.2 * max(load - 1.0, 0.0), 0.5, 0.8 - 0.06 * min(load, 1.0)])
    )
    body.advance(1.0)
    u = body.displacement
    assert touch.leapt(u, 1.0, u, 2.0) == ""
