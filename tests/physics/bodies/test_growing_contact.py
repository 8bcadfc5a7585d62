"""A condensed organ under a growing contact: Hertz's closed form, passivity at a point, finite in hard cases."""

import math
from functools import lru_cache

import numpy as np
import pytest
from pressing import CondensedBody, Spreader
from pytest import approx

from palpate.physics.bodies import hat_distances
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.contact.area import WIDTH, ball, fingertip, of_table, radius_at
from palpate.physics.contact.series import exponential, kernel_form, power, series_step
from palpate.physics.contact.terminal import Terminal
from palpate.physics.geometry.mesh import plane

YOUNG, POISSON, RADIUS, PATCH = 19e3, 0.45, 8e-3, 8e-3
E = YOUNG / (1.0 - POISSON**2)
FOOT, UP = (1.3e-3, -0.4e-3, 0.0), (0.0, 0.0, 1.0)
LAWS = {
    "ball": ball(RADIUS, E), "fingertip": fingertip(RADIUS, E),
    "table": of_table([0.05, 0.2, 1.0, 1.25], [1e-3, 3e-3, 3e-3, 4e-3]),
}  # fmt: skip
laws = pytest.mark.parametrize("name", LAWS)


@lru_cache(maxsize=1)
def half_space():
    coarse = plane(0.1, 600)
    table = (1.0 - POISSON**2) / math.pi * hat_distances.mean_inverse_distance(coarse)
    size = len(coarse.vertices)
    compliance = np.zeros((size, 3, size, 3))
    for i in range(3):
        compliance[:, i, :, i] = table
    return Basis(coarse.vertices, coarse.triangles, compliance.reshape(3 * size, -1).astype(np.float32))


@lru_cache(maxsize=1)
def fine():
    return plane(0.1, 3000)


class Half:
    """A half-space under one contact, with the load that spread.Kernel computes from the area law."""

    def __init__(self, area, retardation=0.0, sticks=False, **more):
        self.area, self.spreader = area, Spreader(fine(), PATCH, "hertz" if len(area.forces) else "biweight")
        self.body = CondensedBody(
            half_space(), fine(), YOUNG, retardation, PATCH, 0.02, POISSON, sticks, area=area, **more
        )

    def press(self, force, dt=1e-3, foot=FOOT):
        """Present indentation [m]; sets `law`, the law of the next step."""
        count = 0
        if force > 0.0:
            wide = radius_at(self.area.forces, self.area.radii, force) if len(self.area.forces) else 0.0
            count = self.spreader.spread(foot, UP, (0.0, 0.0, -force), wide)
        now = self.body.step(self.spreader.nodes[:count], self.spreader.forces[:count], foot, UP, dt)[2]
        self.law = Terminal(*self.body.laws[0])
        return now


@pytest.mark.parametrize("force", [1e-3, 0.01, 0.1, 1.0])
def test_a_rigid_ball_gives_the_law_of_hertz(force):
    body = Half(LAWS["ball"])
    depth = body.press(force)
    right = (0.75 * force / (E * math.sqrt(RADIUS))) ** (2.0 / 3.0)
    assert depth == approx(right, rel=2e-3)
    law = body.law
    assert law.exponent == approx(1.5, rel=0.02)
    assert law.stiffness * (depth - law.rest_indentation) ** law.exponent == approx(force, rel=1e-6)
    assert body.body.stored() == approx(0.4 * force * right, rel=5e-3)
    assert set(body.body.causes()) <= {"slides"}


def test_the_surface_under_a_ball_has_the_shape_of_the_ball():
    body, force = Half(LAWS["ball"]), 1.0
    body.press(force)
    a = radius_at(body.area.forces, body.area.radii, force)
    nodes, moved = body.body.displaced(FOOT)
    away = np.linalg.norm(fine().vertices[nodes] - FOOT, axis=1)
    under = away < 0.95 * a
    assert under.sum() > 20
    assert -moved[under, 2] == approx(a * a / RADIUS - away[under] ** 2 / (2 * RADIUS), rel=0.02)


@laws
@pytest.mark.parametrize("retardation", [0.0, 0.02])
@pytest.mark.parametrize("dt", [1e-4, 1e-3, 0.3])
def test_no_force_history_generates_energy(name, retardation, dt):
    """For any forces from rest, the work on the body is never negative, and its stored energy never exceeds the
    work."""
    rng = np.random.default_rng(7)
    for scale in (0.01, 1.0, 5.0):
        body, work, before = Half(LAWS[name], retardation, rho=nonlinearity(POISSON)), 0.0, 0.0
        for force in scale * rng.choice([0.0, 1.0, 1.0, 1.0], 300) * rng.uniform(0.0, 1.0, 300) ** 3:
            depth = body.press(force, dt)
            work, before = work + force * (depth - before), depth
            assert work >= -1e-12 * scale
            assert body.body.stored() <= work + 1e-3 * scale * abs(depth) + 1e-12


def driven(body, finger, approaches, dt):
    """Forces, and the work of the hand [J], as contact.Series presses."""
    compression, law, forces = 0.0, Terminal(1e3, 1.0), []
    for e in approaches:
        force, compression, _ = series_step(e, dt, compression, finger, *law)
        body.press(force, dt)
        law = body.law
        forces.append(force)
    path = np.diff(approaches, prepend=0.0)
    return np.array(forces), float(np.sum(np.array(forces) * path))


RIGID, SOFT = kernel_form(power(1e12, 1.0), 0.0), kernel_form(exponential(26.2641, 1681.06), 8.0)


@pytest.mark.parametrize("dt", [1e-3, 1e-4])
def test_a_rigid_finger_follows_hertz_during_press_and_release(dt):
    """The ball of `bench accuracy`, on a half-space: at most 3 % RMS."""
    times = np.arange(0.0, 0.5, dt)
    approaches = 5e-4 * np.sin(np.pi * times / 0.5) ** 2
    forces, _ = driven(Half(LAWS["ball"]), RIGID, approaches, dt)
    right = 4.0 / 3.0 * E * math.sqrt(RADIUS) * approaches**1.5
    assert math.sqrt(np.mean((forces - right) ** 2)) < 3e-3 * right.max()
    work = np.sum(0.5 * (forces[1:] + forces[:-1]) * np.diff(approaches))
    assert abs(work) < 2e-3 * 0.4 * right.max() * 5e-4


def test_a_viscous_half_space_under_a_ball_follows_lee_and_radok():
    """While the contact grows, a³ and d³ᐟ² follow the force through the creep of the solid: tau h' + h = f, d(h)."""
    tau, dt = 0.02, 1e-3
    body, h = Half(LAWS["ball"], tau), 0.0
    for force in np.linspace(0.0, 0.5, 100)[1:]:
        h = (tau * h + dt * force) / (tau + dt)
        assert body.press(force, dt) == approx((0.75 * h / (E * math.sqrt(RADIUS))) ** (2.0 / 3.0), rel=2e-3)


@laws
@pytest.mark.parametrize("finger", [RIGID, SOFT], ids=["rigid", "soft"])
@pytest.mark.parametrize("retardation", [0.0, 0.02])
@pytest.mark.parametrize("dt", [1e-3, 0.05])
def test_hard_cases_stay_finite_and_passive(name, finger, retardation, dt):
    rng = np.random.default_rng(3)
    tap = 4e-3 * np.abs(np.sin(np.pi * np.arange(60) / 15.0))
    jumps = rng.choice([-1e-3, 0.0, 1e-6, 2e-3, 10e-3], 60)
    chatter = np.tile([1e-5, -1e-5, 2e-5, 0.0], 15)
    for path in (tap, jumps, chatter):
        approaches = np.concatenate([path, np.full(5, -1e-3)])
        forces, _ = driven(Half(LAWS[name], retardation), finger, approaches, dt)
        assert np.isfinite(forces).all() and (forces >= 0.0).all() and forces[-1] == 0.0
        work = np.sum(forces * np.diff(approaches, prepend=0.0))
        assert work >= -2e-3 * np.sum(forces * np.abs(np.diff(approaches, prepend=0.0)))


def test_a_force_outside_the_area_law_is_reported():
    body = Half(LAWS["table"])
    body.press(2.5)
    assert "grown" in body.body.causes() and "exceeds the range of scene.surface.area by 100%" in body.body.caution(
        "grown"
    )
    assert body.body.extrapolation >= 1.0


def test_distant_contacts_act_separately_and_close_ones_indent_deeper():
    depths = {}
    for away in (0.01, 0.03):
        one = Half(LAWS["ball"])
        body, loads = one.body.under(2), []
        for x in (-0.5 * away, 0.5 * away):
            foot, wide = (x, 0.0, 0.0), float(radius_at(one.area.forces, one.area.radii, 0.05))
            count = one.spreader.spread(foot, UP, (0.0, 0.0, -0.05), wide)
            loads.append((one.spreader.nodes[:count].copy(), one.spreader.forces[:count].copy(), foot, UP))
        for _ in range(3):
            depths[away] = [number[2] for number in body.steps(loads, 1e-3)]
        far = 0.05 / (math.pi * E * away)  # of a point force
        alone = Half(LAWS["ball"]).press(0.05)
        assert depths[away] == approx([alone + far] * 2, rel=0.03)
        law, coupling = body.laws, body.own.coupling
        predicted = law[0, 3] + (0.05 + coupling[0, 1] * 0.05) / law[0, 0]
        assert predicted == approx(depths[away][0], rel=1e-3)


def test_two_contacts_store_the_work_done_on_them():
    one = Half(LAWS["ball"])
    body, work, before = one.body.under(2), 0.0, np.zeros(2)
    steps = 0.05 * (np.arange(1, 101) / 100.0) ** 3
    for last, force in zip(np.append(0.0, steps), steps, strict=False):
        loads = []
        for x in (-8e-3, 8e-3):
            wide = float(radius_at(one.area.forces, one.area.radii, force))
            count = one.spreader.spread((x, 0.0, 0.0), UP, (0.0, 0.0, -force), wide)
            nodes, forces = one.spreader.nodes[:count].copy(), one.spreader.forces[:count].copy()
            loads.append((nodes, forces, (x, 0.0, 0.0), UP))
        depths = np.array(body.steps(loads, 1e-3))[:, 2]
        work, before = work + 0.5 * (last + force) * float((depths - before).sum()), depths
    assert body.stored() == approx(work, rel=5e-3)


def test_the_depth_table_includes_the_contact_radius():
    body = Half(of_table([10.0], [3e-3]), rho=nonlinearity(POISSON))
    body.press(3.0)
    a = radius_at(body.area.forces, body.area.radii, 3.0)
    assert ("depth" in body.body.causes()) == (body.body.own.contacts["now"][0] > 1.5 * WIDTH * a)
