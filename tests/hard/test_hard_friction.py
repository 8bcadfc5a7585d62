"""Hard cases of friction: stiff bristles, standstill, turning normals, loads without bound."""

import math

import bristles as bristle
import numpy as np
import pytest
from formulas import bristle_path
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.physics.friction.bristle import turn
from palpate.physics.friction.coulomb import Coulomb
from palpate.physics.friction.elastoplastic import ElastoPlastic
from palpate.physics.friction.lugre import LuGre, passive_viscous, stribeck

LAW = LuGre()
LAWS = [LAW, LAW._replace(update="euler"), ElastoPlastic()]
steps = st.floats(-6, 1).map(lambda e: 10.0**e)  # 1 us to 10 s
stiffnesses = st.floats(-1, 7).map(lambda e: 3.0 * 10.0**e)  # [1/m], eight decades
speeds = st.floats(-10.0, 10.0)
paths = st.lists(st.tuples(speeds, speeds), min_size=1, max_size=12)


def tangential(path):
    return np.column_stack([np.array(path, float), np.zeros(len(path))])


def explicit(slip, dt, law):
    """The usual method: bristles by explicit Euler, z+ = z + T (v - sigma0 |v| z/g)."""
    z, line = 0.0, []
    for v in slip:
        g = stribeck(abs(v), law.mu_slide, law.mu_static, law.stribeck)
        z += dt * (v - law.bristle_stiffness * abs(v) * z / g)
        line.append(z)
    return np.array(line)


def test_explicit_bristles_diverge_where_implicit_ones_do_not():
    """Stiff bristles at speed. At 1 m/s and 1 ms explicit Euler multiplies each error by 1 - sigma0 v T/g = -5: it
    grows and changes sign each step. The exact step goes to its limit without a change of sign."""
    slip, most = np.full(40, 1.0), LAW.mu_static / LAW.bristle_stiffness
    usual = explicit(slip, 1e-3, LAW)
    assert np.abs(usual).max() > 1e6 * most and (np.sign(usual[1:]) == -np.sign(usual[:-1])).sum() > 30
    for law in LAWS:
        _, z, _ = bristle_path(law, slip[:, None] * (1, 0, 0), 1.0, 1e-3)
        assert (z[:, 0] > 0).all() and (z[:, 0] <= most).all()


@settings(deadline=None)
@example([(0.0, 7.0), (0.0, -7.0)], 0.1, 0.3, 1.0, LAW)
@given(paths, steps, stiffnesses, st.floats(0, 1e3), st.sampled_from(LAWS))
def test_bristles_stay_within_their_limit_at_any_step_and_stiffness(path, dt, stiffness, load, law):
    """Any path, reversals and jumps of speed included: |z| <= mu_s/sigma0, and the force stays below the load times
    the greatest coefficient that the law has."""
    law = law._replace(bristle_stiffness=stiffness)
    slip = tangential(path)
    force, z, _ = bristle_path(law, slip, load, dt)
    most = law.mu_static / stiffness
    fast = np.linalg.norm(slip, axis=1).max()
    assert np.isfinite(force).all() and (np.linalg.norm(z, axis=1) <= most * (1 + 1e-9)).all()
    # |dz/dt| = |v - sigma0 |v| z/g| is more than |v| after a reversal; a step crosses its limits no more than twice.
    bend = law.bristle_damping * min((1 + law.mu_static / law.mu_slide) * fast, 2 * most / dt)
    assert (
        np.linalg.norm(force, axis=1).max() <= load * (law.mu_static + bend + law.viscous * fast) * (1 + 1e-9) + 1e-300
    )


@settings(deadline=None)
@given(paths, steps, st.sampled_from(LAWS), st.floats(1e-3, 10.0))
def test_bristles_under_constant_load_generate_no_energy(path, dt, law, load):
    """What a hand puts in along any path is at least what the bristles hold: f.v T summed >= f_n sigma0 |z|^2/2."""
    slip = tangential(path)
    force, z, _ = bristle_path(law, slip, load, dt)
    work = float((force * slip).sum() * dt)
    stored = 0.5 * load * law.bristle_stiffness * float(z[-1] @ z[-1])
    assert work >= stored - 1e-9 * (abs(work) + stored) - 1e-18


@settings(deadline=None)
@given(st.lists(st.tuples(speeds, speeds, st.floats(-9, 9)), min_size=2, max_size=12), steps, st.sampled_from(LAWS))
def test_bristles_under_a_load_that_jumps_by_decades_generate_no_energy(path, dt, law):
    """Each step by itself: work - growth of what is held >= 0. What a falling load took from the bristles, and may give
    back, is held, too."""
    slip, load = tangential([p[:2] for p in path]), 10.0 ** np.array([p[2] for p in path])
    kernel, bristles, before = bristle.kernel_form(law), bristle.Bristles(), 0.0
    for v, f in zip(slip, load.tolist(), strict=True):
        bristles, force, _ = bristle.step(kernel, bristles, (0.0, 0.0, 1.0), tuple(v.tolist()), f, dt)
        work = float(np.dot(force, v)) * dt
        stored = 0.5 * f * law.bristle_stiffness * float(np.dot(bristles.z, bristles.z)) + bristles.spare
        assert work - stored + before >= -1e-9 * (abs(work) + stored + before) - 1e-18
        before = stored


def test_bristles_without_the_viscous_bound_generate_energy():
    """The usual parameters leave sigma2 at 0: below sigma1 (mu_s - mu_c)/mu_c a path exists that gains energy."""
    law = LAW._replace(viscous=0.0, bristle_damping=20.0)
    assert law.viscous < passive_viscous(law.mu_slide, law.mu_static, law.bristle_damping)

    def gain(law):
        """Energy [J] generated in a fast short slip by bristles that were loaded during creep, where friction is high:
        loss of stored energy plus work on the hand."""
        slip = np.concatenate([np.full(400, 1e-3), np.full(20, 1.0)])[:, None] * (1, 0, 0)
        dt = np.concatenate([np.full(400, 1e-3), np.full(20, 1e-6)])
        force, z, _ = bristle_path(law, slip, 1.0, dt)
        held = 0.5 * law.bristle_stiffness * (z**2).sum(axis=1)
        return (held[-1] - held[-21]) - float((force * slip).sum(axis=1)[-20:] @ dt[-20:])

    assert gain(law) > 1e-6
    bound = passive_viscous(law.mu_slide, law.mu_static, law.bristle_damping)
    assert gain(law._replace(viscous=bound)) <= 0.0


def test_the_sign_function_chatters_at_rest_where_the_elastic_stick_does_not():
    """A block under a push below the friction limit. With Coulomb's law as mu f_n sign(v) it oscillates at every step
    without end; with tanh(v/v0) it creeps. With elastic stick it comes to rest."""
    mass, push, mu, dt = 0.01, 0.2, 0.5, 1e-3

    def block(friction, count=4000):
        v, x, line, state = 0.0, 0.0, [], None
        for _ in range(count):
            pull, state = friction(v, state)
            v += dt * (push - pull) / mass
            x += v * dt
            line.append((x, v, pull))
        return np.array(line).T

    _, v, pull = block(lambda v, s: (mu * np.sign(v), s))
    assert (np.diff(np.sign(pull[-100:])) != 0).sum() > 30 and np.abs(v[-100:]).max() > 0.01
    x, *_ = block(lambda v, s: (mu * math.tanh(v / 0.02), s))
    assert x[-1] - x[-1001] > 0.005  # creeps a centimetre in a second

    law = Coulomb(mu, 1500.0)
    kernel = bristle.kernel_form(law)

    def elastic(v, state):
        state, force, _ = bristle.step(kernel, state or bristle.Bristles(), (0.0, 0.0, 1.0), (v, 0.0, 0.0), 1.0, dt)
        return force[0] + 2.0 * v, state  # a little drag damps the oscillation on the spring

    x, v, _ = block(elastic)
    assert x[-1] == approx(push / law.stiffness, rel=1e-3) and abs(v[-1]) < 1e-6


@settings(deadline=None)
@given(st.lists(st.integers(0, 2**31), min_size=1, max_size=30), steps)
def test_a_turning_normal_keeps_the_bristles_where_projection_loses_them(seeds, dt):
    """Over a round body the tangent plane turns each step. The smallest rotation keeps the length of z; projection, the
    usual way, shortens it each time, and friction fades under a finger that rolls."""
    z, n = (1e-4, 0.0, 0.0), np.array([0.0, 0.0, 1.0])
    usual, shorter = np.array(z), False
    for seed in seeds:
        m = Rotation.from_rotvec(np.random.default_rng(seed).normal(size=3)).apply(n)
        if n @ m < -0.99:
            continue
        z = turn(*z, *n, *m)
        usual = usual - (usual @ m) * m
        shorter = shorter or abs(n @ m) < 0.99
        n = m
        assert np.linalg.norm(z) == approx(1e-4, rel=1e-9) and abs(np.dot(z, n)) < 1e-15
    assert np.linalg.norm(usual) <= 1e-4 * (1 + 1e-9)


def test_projection_loses_a_bristle_on_a_quarter_turn():
    z = turn(1e-4, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0)
    assert z == approx((0.0, 0.0, -1e-4)) or z == approx((0.0, 0.0, 1e-4))
    usual = np.array([1e-4, 0.0, 0.0])
    usual = usual - usual[0] * np.array([1.0, 0.0, 0.0])
    assert np.linalg.norm(usual) == 0.0


@settings(deadline=None)
@given(paths, steps, st.sampled_from([*LAWS, Coulomb()]), st.integers(0, 2**31))
def test_friction_is_the_same_when_the_scene_is_turned(path, dt, law, seed):
    slip, turned = tangential(path), Rotation.random(random_state=seed)
    n = np.array([0.0, 0.0, 1.0])
    force, _, _ = bristle_path(law, slip, 1.3, dt, n)
    other, _, _ = bristle_path(law, turned.apply(slip), 1.3, dt, turned.apply(n))
    assert other == approx(turned.apply(force), abs=1e-6 * (1e-6 + np.abs(force).max()))


@settings(deadline=None)
@given(
    st.sampled_from([0.0, 5e-324, 1e-310, 1e-9, 1e9, 1e100]),
    st.sampled_from([0.0, 5e-324, 1e-310, 1e-12, 10.0]),
    steps,
    st.sampled_from([*LAWS, Coulomb()]),
)
def test_subnormal_and_huge_loads_and_speeds_give_finite_forces(load, speed, dt, law):
    """Nothing, hardly anything and far too much: finite, along the motion, zero without load."""
    force, z, _ = bristle_path(law, np.tile([speed, 0.0, 0.0], (3, 1)), load, dt)
    assert np.isfinite(force).all() and np.isfinite(z).all() and (force[:, 0] >= 0.0).all()
    if load == 0.0:
        assert not force.any() and not z.any()


@pytest.mark.parametrize("seed", range(3))
def test_the_force_across_the_sliding_direction_is_a_transient_of_turns(seed):
    """f_b = F . (n x v^), Fig. 10 of the kidney paper: 0 on a straight path; after a turn of 90 degrees it decays over
    the distance g/sigma0 in which the bristles turn."""
    law, speed, dt, turned = LAW._replace(bristle_damping=0.0), 0.05, 1e-4, Rotation.random(random_state=seed)
    ahead, n = np.repeat([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], [2000, 200], axis=0), turned.apply((0.0, 0.0, 1.0))
    force, _, _ = bristle_path(law, turned.apply(speed * ahead), 1.3, dt, n)
    across = (force * np.cross(n, turned.apply(ahead))).sum(axis=1)
    assert np.abs(across[:2000]).max() < 1e-12
    steady = stribeck(speed, law.mu_slide, law.mu_static, law.stribeck)
    decay = np.exp(-law.bristle_stiffness * speed * dt * np.arange(1, 201) / steady)
    assert np.abs(across[2000:]) == approx(1.3 * steady * decay, rel=1e-6)


def test_stick_slip_at_low_speed_holds_the_friction_between_its_two_coefficients():
    """A block pulled by a spring at 0.5 mm/s. Static friction is above sliding friction, so it sticks and slips. The
    peak force of the spring is static friction, at steps of both 0.2 ms and 0.1 ms; explicit bristles of the same law
    diverge in a fast slip."""
    law = bristle.kernel_form(LAW._replace(bristle_stiffness=2e5, stribeck=2e-3, viscous=0.0, bristle_damping=0.2))

    def pull(dt):
        mass, spring, drive, load = 0.05, 2000.0, 5e-4, 1.0
        x = v = 0.0
        state, line = bristle.Bristles(), []
        for i in range(round(3.0 / dt)):
            state, force, _ = bristle.step(law, state, (0.0, 0.0, 1.0), (v, 0.0, 0.0), load, dt)
            line.append(spring * (drive * i * dt - x))
            v += dt * (line[-1] - force[0]) / mass
            x += v * dt
        return np.array(line)

    coarse, fine = pull(2e-4), pull(1e-4)
    for line in (coarse, fine):
        assert np.isfinite(line).all() and line.max() == approx(LAW.mu_static, rel=0.03)
        late = line[len(line) // 2 :]
        assert 0.0 < late.min() < 0.5 < late.max()  # it does slip, and more than once
    fast = np.full(60, 1.0)
    assert np.abs(explicit(fast, 1e-3, LAW)).max() > 1.0
