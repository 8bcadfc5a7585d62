"""Friction: LuGre and Coulomb laws over irregular steps, and their nodes."""

import math

import bristles as bristle
import numpy as np
import pytest
from bristles import Bristles
from formulas import bristle_path, steady_friction
from hypothesis import given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Proximity
from palpate.nodes.friction import Coulomb, ElastoPlastic, LuGre
from palpate.physics.friction.bristle import turn
from palpate.physics.friction.coulomb import Coulomb as CoulombLaw
from palpate.physics.friction.elastoplastic import ElastoPlastic as Elastic
from palpate.physics.friction.lugre import LuGre as Law
from palpate.physics.friction.lugre import passive_viscous

LAW = Law(0.5, 0.7, 0.02, 3000.0, 1.0, 0.4)
ELASTIC = Elastic(0.5, 0.7, 0.02, 3000.0, 1.0, 0.4)
UP = (0.0, 0.0, 1.0)
X = np.array([1.0, 0.0, 0.0])
EXPONENTIAL, EULER = LAW, LAW._replace(update="euler")
both = pytest.mark.parametrize("law", [EXPONENTIAL, EULER], ids=["exponential", "euler"])
every = pytest.mark.parametrize("law", [EXPONENTIAL, EULER, ELASTIC], ids=["exponential", "euler", "elastic"])


def lugre_path(slip, load, dt, law, normal=UP):
    return bristle_path(law, slip, load, dt, normal)[:2]


def coulomb_path(slip, load, dt, mu, stiffness):
    return bristle_path(CoulombLaw(mu, stiffness, 0.0), slip, load, dt)


def test_steady_sliding_has_the_closed_form():
    speeds = [1e-3, 0.01, 0.02, 0.05, 0.1, 0.5]
    expected = [0.699901, 0.659760, 0.581576, 0.520386, 0.540000, 0.700000]
    assert steady_friction(speeds, LAW) == approx(expected, abs=1e-6)
    for v, mu in zip(speeds, expected, strict=True):
        force, _ = lugre_path(np.tile(v * X, (400, 1)), 2.0, 0.1, LAW)
        assert force[-1] == approx([2.0 * mu, 0, 0], abs=3e-6)


@pytest.mark.parametrize("steps", [1, 7, 2000])
def test_at_constant_velocity_the_deflection_does_not_depend_on_the_step(steps):
    _, z = lugre_path(np.tile(0.05 * X, (steps, 1)), 1.0, 0.02 / steps, LAW)
    assert z[-1, 0] == approx(166.380e-6, abs=5e-10)
    _, z = lugre_path(np.tile([0.03, -0.02, 0.0], (steps, 1)), 1.0, 0.004 / steps, LAW)
    _, once = lugre_path([[0.03, -0.02, 0.0]], 1.0, 0.004, LAW)
    assert z[-1] == approx(once[-1], rel=1e-10)


def test_the_deflection_follows_the_differential_equation():
    def rate(t, z):
        v = 0.08 * math.sin(30 * t)
        g = 0.5 + 0.2 * math.exp(-((v / 0.02) ** 2))
        return [v - 3000 * abs(v) * z[0] / g]

    exact = solve_ivp(rate, (0, 0.3), [0.0], rtol=1e-10, atol=1e-14, max_step=1e-3).y[0, -1]
    errors = []
    for count in (3000, 6000, 12000):
        t = np.arange(1, count + 1) * 0.3 / count
        v = np.outer(0.08 * np.sin(30 * t), X)
        errors.append(abs(lugre_path(v, 1.0, 0.3 / count, LAW)[1][-1, 0] - exact))
    assert errors[0] / errors[1] == approx(2, rel=0.15) and errors[1] / errors[2] == approx(2, rel=0.15)


@every
@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10), st.floats(-6, 0)), min_size=1, max_size=20))
def test_the_deflection_never_exceeds_its_bound(law, path):
    v = np.array([[a, b, 0.0] for a, b, _ in path])
    dt = 10.0 ** np.array([x for _, _, x in path])
    force, z = lugre_path(v, 3.0, dt, law)
    assert np.isfinite(force).all()
    assert (np.linalg.norm(z, axis=1) <= 0.7 / 3000 * (1 + 1e-12)).all()


@every
@pytest.mark.parametrize("speed", [0.01, 0.33, 1.0, 10.0])
@pytest.mark.parametrize("dt", [1e-6, 1e-3, 1.0])
def test_stiff_bristles_do_not_oscillate(law, speed, dt):
    _, z = lugre_path(np.tile(speed * X, (50, 1)), 1.0, dt, law)
    assert (np.diff(z[:, 0]) >= -1e-18).all() and (z[:, 0] > 0).all()


@every
def test_motion_on_a_line_follows_the_one_dimensional_law(law):
    rng = np.random.default_rng(1)
    along = rng.normal(0, 0.1, 200)
    for angle in (0.4, 2.0, -1.3):
        d = np.array([math.cos(angle), math.sin(angle), 0.0])
        force, z = lugre_path(np.outer(along, d), 1.3, 1e-3, law)
        straight, zs = lugre_path(np.outer(along, X), 1.3, 1e-3, law)
        assert force == approx(np.outer(straight[:, 0], d), abs=1e-12)
        assert z == approx(np.outer(zs[:, 0], d), abs=1e-15)


def test_the_law_is_the_same_in_any_frame():
    rng = np.random.default_rng(2)
    v, normal = rng.normal(0, 0.1, (100, 3)), rng.normal(size=(100, 3))
    normal = np.array([0, 0, 1.0]) + 0.2 * normal
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    r = Rotation.from_rotvec([0.3, -1.1, 0.7])
    force, z = lugre_path(v, 1.0, 1e-3, LAW, normal)
    turned, zt = lugre_path(r.apply(v), 1.0, 1e-3, LAW, r.apply(normal))
    assert turned == approx(r.apply(force), abs=1e-11) and zt == approx(r.apply(z), abs=1e-14)
    assert np.abs(np.sum(force * normal, axis=1)).max() < 1e-13


def test_friction_is_proportional_to_the_normal_force():
    v = np.tile(0.05 * X, (30, 1))
    one, _ = lugre_path(v, 1.0, 1e-3, LAW)
    assert lugre_path(v, 4.2, 1e-3, LAW)[0] == approx(4.2 * one)
    assert np.abs(lugre_path(v, 1e-12, 1e-3, LAW)[0]).max() < 1e-11


def test_friction_rises_with_speed_beyond_the_stribeck_dip():
    mu = steady_friction(np.linspace(0.06, 1.0, 50), LAW)
    assert (np.diff(mu) > 0).all()


def test_presliding_is_a_spring_of_stiffness_f_n_sigma0():
    force, _ = lugre_path([[1e-6, 0, 0]], 2.0, 1e-3, LAW._replace(bristle_damping=0.0, viscous=0.0))
    assert force[0, 0] == approx(2.0 * 3000 * 1e-9, rel=1e-4)


@every
def test_a_hysteresis_loop_closes_and_dissipates(law):
    t = np.arange(4000) * 1e-4
    for amplitude in (2e-5, 3e-4, 2e-3):
        v = np.outer(amplitude * 2 * np.pi * 10 * np.cos(2 * np.pi * 10 * t), X)
        force, z = lugre_path(v, 1.0, 1e-4, law)
        # A loop much smaller than the reach of the bristles drifts for many cycles before it closes.
        assert amplitude < 1e-4 or force[3000:, 0] == approx(force[2000:3000, 0], abs=1e-5)
        supplied = force[3000:, 0] @ v[3000:, 0] * 1e-4
        assert supplied > 1500 * (z[-1, 0] ** 2 - z[2999, 0] ** 2)


def _least_margin(law):
    """Minimum of supplied minus stored energy over many single steps from random deflections, over the supply."""
    rng = np.random.default_rng(3)
    least = math.inf
    law = bristle.kernel_form(law)
    for _ in range(5000):
        r, a, b = rng.uniform(0, 0.7 / 3000), *rng.uniform(0, 2 * np.pi, 2)
        v = 10 ** rng.uniform(-5, 1) * np.array([math.cos(b), math.sin(b), 0.0])
        dt = 10 ** rng.uniform(-6, 0)
        z = (r * math.cos(a), r * math.sin(a), 0.0)
        after, force, _ = bristle.step(law, Bristles(z, UP, 1.0), UP, tuple(v.tolist()), 1.0, dt)
        supply = float(np.dot(force, v)) * dt
        stored = 1500.0 * (np.dot(after.z, after.z) - np.dot(z, z))
        least = min(least, (supply - stored) / (abs(supply) + abs(stored)))
    return least


@every
def test_the_law_is_passive_exactly_under_the_bound_on_viscous_friction(law):
    assert passive_viscous(0.5, 0.7, 1.0) == approx(0.4)
    assert _least_margin(law) > -1e-12
    assert _least_margin(law._replace(viscous=0.0)) < -1e-3


def test_a_rising_load_on_resting_bristles_generates_no_energy():
    v = np.array([[0.05, 0, 0]] * 30 + [[0, 0, 0]])
    load = np.array([1.0] * 30 + [6.0])
    _, z = lugre_path(v, load, 1e-3, LAW._replace(rescale=False))
    free = 0.5 * 3000 * (6 * z[-1] @ z[-1] - z[-2] @ z[-2])
    assert 0 < free <= 0.5 * 5 * 0.7**2 / 3000 * (1 + 1e-9)
    _, z = lugre_path(v, load, 1e-3, LAW)
    assert 6 * z[-1] @ z[-1] == approx(z[-2] @ z[-2], rel=1e-12)


@every
def test_rescaling_changes_no_bit_if_no_energy_is_generated(law):
    """Cases: a constant load, a falling one, and one that rises slowly in a slide, where slip dissipates far more."""
    plain = law._replace(rescale=False)
    v = np.tile(0.05 * X, (300, 1))
    for load in (2.0, np.linspace(2.0, 0.5, 300), np.r_[np.full(100, 1.0), np.linspace(1.0, 3.0, 200)]):
        for one, other in zip(bristle_path(law, v, load, 1e-3), bristle_path(plain, v, load, 1e-3), strict=True):
            assert np.array_equal(one, other)


def generated(law, motions, seed):
    """Generated energy over the total work, for each motion: random walks and random jumps of the slip velocity and of
    the load, in steps of 0.1 to 10 ms. D = work - stored must never fall below an earlier value."""
    rng, steps = np.random.default_rng(seed), 40
    shares = np.empty(motions)
    for k in range(motions):
        dt, swing = 10.0 ** rng.uniform(-4, -2), rng.uniform(0.05, 1.5)
        walks = [
            np.cumsum(r, axis=0) / 4 if rng.random() < 0.5 else r for r in (rng.normal(size=(steps, n)) for n in (2, 1))
        ]
        v = np.column_stack((10.0 ** rng.uniform(-4, 0) * walks[0], np.zeros(steps)))
        load = 10.0 ** rng.uniform(-1, 1) * np.exp(swing * walks[1][:, 0])
        kernel, bristles, work, dissipated = bristle.kernel_form(law), Bristles(), np.zeros(steps), np.zeros(steps + 1)
        for i in range(steps):
            bristles, force, _ = bristle.step(kernel, bristles, UP, tuple(v[i].tolist()), float(load[i]), dt)
            work[i] = force @ v[i] * dt
            stiffness = law.stiffness if isinstance(law, CoulombLaw) else law.bristle_stiffness * load[i]
            stored = 0.5 * stiffness * np.dot(bristles.z, bristles.z) + bristles.spare
            dissipated[i + 1] = work.sum() - stored
        shares[k] = (np.maximum.accumulate(dissipated) - dissipated).max() / np.abs(work).sum()
    return shares


@pytest.mark.parametrize("play", [0.0, 30e-6, 1e-3])
def test_motion_within_the_play_does_not_relax_the_bristles(play):
    """A finger strained by 0.1 mm moves on circles of 20 um for 10 s, 20 mm in all. The force is constant if the
    circles are within the play; without play the relaxation e^(-sigma0 path/g) removes it. A slide has the same
    friction as without play."""
    law, dt = LAW._replace(bristle_stiffness=500.0, play=play), 1e-3
    angle = 100.0 * dt * np.arange(10_001)
    circle = 20e-6 * np.column_stack((np.cos(angle) - 1.0, np.sin(angle), 0.0 * angle))
    slip = np.concatenate((np.tile(0.01 * X, (10, 1)), np.diff(circle, axis=0) / dt))
    _, z = lugre_path(slip, 1.0, dt, law)
    kept = z[-100:].mean(axis=0)[0] / 0.1e-3
    assert kept > 0.7 if play else kept < 0.1
    slide, _ = lugre_path(np.tile(0.05 * X, (2000, 1)), 2.0, dt, law)
    assert slide[-1] == approx([2.0 * steady_friction([0.05], law)[0], 0, 0], rel=1e-6)


WORN = EXPONENTIAL._replace(play=1e-4)


@pytest.mark.parametrize("law", [EXPONENTIAL, EULER, ELASTIC, CoulombLaw(), WORN], ids=lambda law: type(law).__name__)
def test_no_random_motion_under_a_varying_load_generates_energy(law):
    assert generated(law, 250, seed=4).max() < 1e-9


@every
def test_without_rescaling_most_motions_generate_energy(law):
    shares = generated(law._replace(rescale=False), 100, seed=4)
    assert np.mean(shares > 1e-9) > 0.5 and shares.max() > 0.5


@pytest.mark.parametrize("law", [EXPONENTIAL, EULER, ELASTIC], ids=lambda law: type(law).__name__)
def test_a_load_that_falls_and_rises_again_does_not_change_static_friction(law):
    """Otherwise load noise would shrink the bristles at each rise, by 5 % in 100 oscillations of 0.1 %. If a load rises
    above its earlier maximum, the bristles shrink by the square root of the ratio."""
    v = np.array([[0.05, 0, 0]] * 2 + [[0, 0, 0]] * 201)
    load = np.r_[2.0, 2.0, np.tile([1.9, 2.0], 100), 2.2]
    force, z, _ = bristle_path(law, v, load, 1e-3)
    assert z[-2] == approx(z[1], rel=1e-12) and force[-2] == approx(force[3], rel=1e-12)
    assert z[-1] == approx(z[1] * math.sqrt(2.0 / 2.2), rel=1e-3)


def test_many_falls_of_the_load_do_not_offset_one_large_rise():
    """The spare energy never exceeds the energy stored in the bristles."""
    kernel, bristles = bristle.kernel_form(LAW), Bristles()
    rng = np.random.default_rng(5)
    for load in (0.5 + rng.random(3000)).tolist():
        v = tuple((0.05 * rng.normal(size=2)).tolist())
        bristles, _, _ = bristle.step(kernel, bristles, UP, (*v, 0.0), load, 1e-3)
        assert 0.0 <= bristles.spare <= type(kernel).stored(kernel, bristles.z, load)


def pumped(law, seconds=1.0, dt=5e-5):
    """Largest kinetic energy, over the initial one, of a block of 50 g on bristles. The load is raised when they are
    stretched and lowered when they are straight; no other force works on the block."""
    kernel, bristles, v, start, most, low = bristle.kernel_form(law), bristle.Bristles(), 5e-3, 5e-3, 0.0, 1.0
    stiff = 0.5 * (low + 3.0) * law.bristle_stiffness / 0.05
    for k in range(round(seconds / dt)):
        load = low if math.sin(2.0 * math.sqrt(stiff) * k * dt) < 0.0 else 3.0
        bristles, force, _ = bristle.step(kernel, bristles, UP, (v, 0.0, 0.0), load, dt)
        v -= force[0] / 0.05 * dt
        most = max(most, abs(v) if k * dt > 0.1 else 0.0)
    return (most / start) ** 2


def test_a_pulsating_load_pumps_energy_into_plain_bristles_only():
    """Detected by the motion of a block, without the stored energy that the law reports."""
    mild = Elastic(bristle_damping=0.0, viscous=0.0)
    assert pumped(mild._replace(rescale=False)) > 2.0
    assert pumped(mild) < 1.0


@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_rotation_keeps_the_length_and_the_tangent_plane(x):
    z, a, b = np.array(x).reshape(3, 3)
    if min(np.linalg.norm(a), np.linalg.norm(b)) < 0.1:
        return
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    z = z - (z @ a) * a
    if np.linalg.norm(z) < 1e-3 or a @ b < -0.999:
        return
    turned = np.array(turn(*z, *a, *b))
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    expected = z if sine < 1e-12 else Rotation.from_rotvec(axis / sine * math.atan2(sine, a @ b)).apply(z)
    assert turned == approx(expected, abs=1e-9)
    assert np.linalg.norm(turned) == approx(np.linalg.norm(z))


def test_a_normal_that_flips_keeps_the_deflection():
    assert turn(1e-4, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0) == approx((1e-4, 0, 0))


def test_loss_of_contact_resets_the_bristles():
    force, z = lugre_path(np.tile(0.01 * X, (20, 1)), np.array([1.0] * 10 + [0.0] + [1.0] * 9), 1e-3, LAW)
    assert (force[10] == 0).all() and (z[10] == 0).all()
    assert z[11] == approx(z[0])


def test_coulomb_sticks_as_a_spring_and_slides_at_mu_times_the_load():
    force, _z, stick = coulomb_path(np.tile(0.01 * X, (200, 1)), 2.0, 1e-3, 0.5, 1500.0)
    assert force[:60, 0] == approx(1500 * 1e-5 * np.arange(1, 61))
    assert force[100:, 0] == approx(1.0, rel=1e-12)
    assert stick[:66].all() and not stick[67:].any()


def test_coulomb_is_exact_for_any_step_and_does_not_chatter():
    once, _, _ = coulomb_path([[0.01, 0, 0]], 2.0, 0.2, 0.5, 1500.0)
    many, _, _ = coulomb_path(np.tile(0.01 * X, (2000, 1)), 2.0, 1e-4, 0.5, 1500.0)
    assert once[-1] == approx(many[-1], rel=1e-12)
    assert (np.diff(many[:, 0]) >= -1e-15).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-(10**9), 10**9)] * 2, st.integers(0, 9 * 10**9)), min_size=2, max_size=30))
def test_coulomb_never_generates_energy_under_a_changing_load(path):
    """Values are multiples of nm/s and nN, because squares of numbers below 1e-160 underflow."""
    v, load = 1e-9 * np.array([[a, b, 0.0] for a, b, _ in path]), 1e-9 * np.array([float(f) for _, _, f in path])
    force, z, _ = coulomb_path(v, load, 1e-3, 0.5, 1500.0)
    supplied = np.cumsum(np.sum(force * v, axis=1) * 1e-3)
    stored = 750.0 * np.sum(z * z, axis=1)
    assert (supplied - stored >= -1e-12).all()
    assert (np.linalg.norm(force, axis=1) <= 0.5 * load * (1 + 1e-12)).all()


def contact(load, normal=(0, 0, 1)):
    return Contact(
        foot=(0, 0, 0),
        normal=normal,
        force=load,
        compression=1e-3,
        indentation=1e-3,
        compression_rate=0,
        indentation_rate=0,
    )


def sliding(x, y=0.0):
    return Proximity(
        foot=(0, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0, approach=2e-3, slip=(x, y, 0)
    )


@pytest.mark.parametrize("node", [LuGre(), LuGre(update="euler", rescale=True), ElastoPlastic(), Coulomb()])
def test_the_nodes_send_a_tangential_force_along_the_slip(node):
    bus = FakeBus(node, proximity=sliding(0.03, 0.04))
    answers = bus.publish(*[contact(2.0)] * 300)
    f = np.array(answers[-1].force)
    assert f[2] == 0 and f[:2] / np.linalg.norm(f) == approx([0.6, 0.8], rel=1e-9)
    assert answers[0].stick and not answers[-1].stick
    (apart,) = bus.publish(contact(0.0))
    assert apart.force == (0, 0, 0) and apart.bristle == (0, 0, 0) and not apart.stick


def test_the_lugre_node_equals_the_law():
    bus = FakeBus(LuGre(), proximity=sliding(0.05))
    answers = bus.publish(*[contact(1.5)] * 40)
    force, z = lugre_path(np.tile(0.05 * X, (40, 1)), 1.5, 1e-3, LAW)
    assert [a.force for a in answers] == approx(force) and [a.bristle for a in answers] == approx(z)


@pytest.mark.parametrize("kind", [LuGre, ElastoPlastic])
def test_settings_that_let_the_law_generate_energy_are_reported_once(kind):
    node = kind(viscous=0.1)
    node.start()
    (note,) = node.notes()
    assert "viscous 0.1 s/m" in note and "from 0.4 s/m" in note and not node.notes()
    usual = kind()
    usual.start()
    assert not usual.notes()


def test_a_finger_at_rest_sticks_with_strained_bristles():
    bus = FakeBus(LuGre(), proximity=sliding(0.05))
    *_, before = bus.publish(*[contact(1.0)] * 100)
    bus.publish(sliding(0.0))
    (resting,) = bus.publish(contact(1.0))
    assert not before.stick and resting.stick and resting.force[0] == approx(0.5, abs=0.03)


@pytest.mark.parametrize("node", [LuGre(), ElastoPlastic(), Coulomb()])
def test_a_duplicate_or_reordered_message_changes_nothing(node):
    bus = FakeBus(node, proximity=sliding(0.05))
    bus.twice()
    first, second = bus.publish(contact(1.0))
    assert first.force == second.force and first.bristle == second.bristle
    bus.swap()
    assert all(math.isfinite(a.force[0]) for a in bus.publish(contact(1.0), contact(2.0)))


def drift(law, mean=0.35, swing=0.2, frequency=20.0, seconds=1.0, mass=0.05, dt=1e-4):
    """Creep [m] of a mass with 1 N of normal force under a tangential load [N] that oscillates below static
    friction."""
    law, bristles, x, v, friction, places = bristle.kernel_form(law), Bristles(), 0.0, 0.0, 0.0, []
    for k in range(round(seconds / dt)):
        push = (mean + swing * math.sin(2 * math.pi * frequency * k * dt)) * min(k * dt / 0.1, 1.0)
        v += (push - friction) / mass * dt
        x += v * dt
        bristles, force, _ = bristle.step(law, bristles, UP, (v, 0.0, 0.0), 1.0, dt)
        friction = force[0]
        places.append(x)
    cycle = round(1.0 / frequency / dt)
    return float(np.mean(places[-cycle:]) - np.mean(places[5 * cycle : 6 * cycle]))


def test_only_lugre_creeps_under_an_oscillating_load_below_static_friction():
    assert drift(LAW) > 1e-2  # [m] in a second
    assert abs(drift(ELASTIC)) < 1e-6 and abs(drift(CoulombLaw(0.7, 3000.0))) < 1e-6


def _alpha(r):
    return np.clip(0.5 * np.sin(np.pi * (np.clip(r, 0.9, 1.0) - 0.95) / 0.1) + 0.5, 0.0, 1.0)


def test_the_elasto_plastic_deflection_follows_its_differential_equation():
    """In two dimensions, compared with Radau's method and the published form of alpha."""

    def velocity(t):
        return np.array([0.06 * math.sin(25 * t), 0.04 * math.cos(40 * t)])

    def rate(t, z):
        v = velocity(t)
        speed = math.hypot(*v)
        g = 0.5 + 0.2 * math.exp(-((speed / 0.02) ** 2))
        part = _alpha(3000 * math.hypot(*z) / g) if z @ v > 0 else 0.0
        return v - part * 3000 * speed * z / g

    exact = solve_ivp(rate, (0, 0.3), [0.0, 0.0], method="Radau", rtol=1e-8, atol=1e-12, max_step=1e-4).y[:, -1]
    errors = []
    for count in (1500, 3000, 6000):
        t = (np.arange(count) + 0.5) * 0.3 / count
        v = np.column_stack((*np.array([velocity(s) for s in t]).T, np.zeros(count)))
        errors.append(np.linalg.norm(bristle_path(ELASTIC, v, 1.0, 0.3 / count)[1][-1, :2] - exact))
    assert max(errors) < 0.001 * 0.7 / 3000  # 0.1 % of the reach of the bristles


def test_elasto_plastic_bristles_bend_without_slip_up_to_their_elastic_share():
    way = 0.89 * 0.7 / 3000
    for steps in (1, 10, 1000):
        _, z, stick = bristle_path(ELASTIC, np.tile(1e-3 * X, (steps, 1)), 2.0, way / 1e-3 / steps)
        assert z[-1, 0] == approx(way, rel=1e-9) and stick.all()
    back = np.vstack((np.tile(1e-3 * X, (100, 1)), np.tile(-1e-3 * X, (100, 1))))
    assert bristle_path(ELASTIC, back, 2.0, way / 1e-3 / 100)[1][-1, 0] == approx(0.0, abs=1e-12)


@pytest.mark.parametrize("steps", [1, 5, 50, 2000])
def test_at_constant_velocity_the_elasto_plastic_deflection_hardly_depends_on_the_step(steps):
    _, z, _ = bristle_path(ELASTIC, np.tile([0.03, -0.02, 0.0], (steps, 1)), 1.0, 0.006 / steps)
    _, fine, _ = bristle_path(ELASTIC, np.tile([0.03, -0.02, 0.0], (20000, 1)), 1.0, 0.006 / 20000)
    assert z[-1] == approx(fine[-1], abs=0.005 * 0.7 / 3000)


def test_elasto_plastic_friction_slides_like_lugre():
    for v in (1e-3, 0.02, 0.1, 0.5):
        force, _, stick = bristle_path(ELASTIC, np.tile(v * X, (2000, 1)), 2.0, 1e-3)
        assert force[-1, 0] == approx(2.0 * float(steady_friction(v, LAW)), rel=1e-5) and not stick[-1]
