"""A rigid organ on its foundation: closed forms, equilibrium, energy, a loose organ, stable delayed contacts."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.compiler.fields import blank_record
from palpate.physics.bodies.floating.added_inertia import added_inertia, contact_stiffness
from palpate.physics.bodies.floating.foundation import FIELDS, MOTION, Constants, mechanical_energy, step

UP, NONE, G = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 9.80665
KIDNEY = Constants(0.15, 0.15 * 0.02**2, 0.0, 200.0, 1.5, 130.0, 1.0, 0.03, 0.3, True)
LOOSE = KIDNEY._replace(weight=0.15 * G, attached=False)


def base(given):
    return blank_record(FIELDS, **given._asdict())


def still(**values):
    now = blank_record(MOTION)
    for name, value in values.items():
        now[name][:] = value
    return now


def run(given, now, count, dt, force=NONE, moment=NONE, rise=0):
    """Places; force and moment rise over the first `rise` steps."""
    made, path = base(given), []
    for k in range(count):
        share = min((k + 1) / rise, 1.0) if rise else 1.0
        push, turn = (tuple(share * x for x in each) for each in (force, moment))
        step(made, UP, now, push, turn, (0.0, 0.0), (0.0, 0.0), dt)
        path.append(np.concatenate([now.at, now.turn]))
    return np.array(path)


def decay(time, mass, stiffness, damping):
    """x of m x'' + c x' + k x = 0 with x(0) = 1, at rest; underdamped."""
    rate, whole = damping / (2.0 * mass), stiffness / mass
    fast = np.sqrt(whole - rate * rate)
    return np.exp(-rate * time) * (np.cos(fast * time) + rate / fast * np.sin(fast * time))


@pytest.mark.parametrize("axis, stiffness, damping", [
    (2, 200.0, 1.5), (0, 130.0, 1.0),  # along and across the foundation
    (3, 200.0 * 0.03**2 / 4, 1.5 * 0.03**2 / 4), (5, 130.0 * 0.03**2 / 2, 1.0 * 0.03**2 / 2),  # tilt and twist
])  # fmt: skip
def test_an_organ_that_is_let_go_oscillates_as_a_damped_oscillator_to_first_order(axis, stiffness, damping):
    errors = []
    for dt in (1e-3, 5e-4, 2.5e-4):
        begin = np.zeros(6)
        begin[axis] = 1e-3
        places = {"at": begin[:3], "shear": begin[:3] * (1, 1, 0), "turn": begin[3:], "bend": begin[3:]}
        path = run(KIDNEY, still(**places), round(0.5 / dt), dt)
        inertia = KIDNEY.mass if axis < 3 else KIDNEY.inertia
        expected = 1e-3 * decay(dt * np.arange(1, len(path) + 1), inertia, stiffness, damping)
        errors.append(np.abs(path[:, axis] - expected).max())
        assert np.abs(np.delete(path, axis, axis=1)).max() < 1e-12
    assert errors[0] < 0.05e-3
    assert [errors[0] / errors[1], errors[1] / errors[2]] == approx([2.0, 2.0], rel=0.06)


def test_a_constant_force_and_moment_displace_it_by_their_compliances():
    force, moment = (0.13, -0.26, 0.5), (2e-3, -3e-3, 4e-3)
    end = run(KIDNEY, still(), 4000, 2e-3, force, moment)[-1]
    tilt, twist = 200.0 * 0.03**2 / 4, 130.0 * 0.03**2 / 2
    expected = [0.13 / 130, -0.26 / 130, 0.5 / 200, 2e-3 / tilt, -3e-3 / tilt, 4e-3 / twist]
    np.testing.assert_allclose(end, expected, rtol=1e-9)


def test_it_depends_on_the_direction_of_the_foundation_only_against_that_of_the_forces():
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0])
    for given in (KIDNEY, LOOSE):
        one, other, made = still(), still(), base(given)
        rng = np.random.default_rng(5)
        for _ in range(300):
            force, moment = rng.normal(0.0, 0.8, 3), rng.normal(0.0, 0.02, 3)
            step(made, UP, one, tuple(force), tuple(moment), (0.0, 0.0), (0.0, 0.0), 1e-3)
            step(made, tuple(turn.apply(UP)), other, tuple(turn.apply(force)), tuple(turn.apply(moment)), (0.0, 0.0),
                 (0.0, 0.0), 1e-3)  # fmt: skip
        assert np.abs(one.at).max() > 1e-3 and np.abs(one.turn).max() > 0.02
        for name in ("at", "turn", "shear", "bend", "speed", "rate"):
            np.testing.assert_allclose(other[name], turn.apply(one[name]), rtol=1e-9, atol=1e-12)


def draw_organ(rng):
    """A random organ and foundation: 0.1 g to 1 kg, foundations of 1 N/m to 1 MN/m, loose or attached."""
    mass, stiffness, shear = 10.0 ** rng.uniform(-4, 0), 10.0 ** rng.uniform(0, 6), rng.uniform(0.1, 2.0)
    damping = rng.choice([0.0, 10.0 ** rng.uniform(-3, 3)])
    attached = bool(rng.integers(2))
    return Constants(
        mass, mass * rng.uniform(1e-3, 0.05) ** 2, 0.0 if attached else mass * G, stiffness, damping, shear * stiffness,
        shear * damping, rng.uniform(5e-3, 0.05), rng.choice([0.0, 0.3, 2.0]), attached,
    )  # fmt: skip


def with_added(given, now, added):
    """H of the module: the energy with the added inertias, from which F.dd + Q.dr must not be exceeded."""
    extra = added[0] * np.dot(now.speed, now.speed) + added[1] * np.dot(now.rate, now.rate)
    return mechanical_energy(base(given), UP, now) + 0.5 * extra


def test_no_step_gives_more_energy_than_the_forces_work():
    """Random foundations and forces, contacts that come and go, at 100 Hz to 10 kHz: each step, not only the sum."""
    rng, lifted, slid = np.random.default_rng(11), 0, 0
    for _ in range(150):
        given, now, added = draw_organ(rng), still(), (0.0, 0.0)
        dt, made = 10.0 ** rng.uniform(-4, -2), base(given)
        size, spread = 10.0 ** rng.uniform(-2, 1) * (given.weight or 1.0), rng.uniform(0.001, 0.05)
        for _ in range(60):
            touched = rng.random() < 0.7
            force = rng.normal(0.0, size, 3) * touched
            moment = rng.normal(0.0, size * spread, 3) * touched
            stiff = 10.0 ** rng.uniform(0, 5) * touched
            then = added_inertia(added[0], stiff, dt), added_inertia(added[1], stiff * 1e-4, dt)
            before, at, turn = with_added(given, now, added), now.at.copy(), now.turn.copy()
            step(made, UP, now, tuple(force), tuple(moment), added, then, dt)
            work = force @ (now.at - at) + moment @ (now.turn - turn)
            gained = with_added(given, now, then) - before - work
            scale = abs(before) + abs(work) + with_added(given, now, then)
            assert gained <= 1e-9 * scale + 1e-16, (given, dt)
            added = then
            lifted += not given.attached and now.at[2] > given.weight / given.stiffness
            slid += not given.attached and np.hypot(*(now.at - now.shear)[:2]) > 1e-6
    assert lifted > 100 and slid > 100


def test_a_loose_organ_slides_where_the_force_exceeds_the_friction_of_its_weight():
    """m x'' = F - mu m g."""
    weight = LOOSE.weight
    assert abs(run(LOOSE, still(), 2000, 1e-3, (0.29 * weight, 0.0, 0.0), rise=1500)[-1, 0]) < 0.3 * weight / 130
    path = run(LOOSE._replace(shear_damping=0.0), still(), 1000, 1e-3, (0.5 * weight, 0.0, 0.0))
    fast = np.diff(path[-300:, 0]) / 1e-3
    np.testing.assert_allclose(np.diff(fast) / 1e-3, 0.2 * G, rtol=1e-6)


def test_a_loose_organ_tips_where_the_moment_exceeds_its_weight_times_the_radius_of_its_footprint():
    most = LOOSE.weight * 0.03
    assert abs(run(LOOSE, still(), 4000, 1e-3, NONE, (0.97 * most, 0.0, 0.0), 3000)[-1, 3]) < 1.1 * most / (
        200 * 0.03**2 / 4
    )
    assert np.diff(run(LOOSE, still(), 4000, 1e-3, NONE, (1.03 * most, 0.0, 0.0), 3000)[:, 3])[-1] > 1e-3


def test_a_dropped_organ_falls_freely_lands_and_rests():
    height, dt = 0.02, 1e-4
    path = run(LOOSE, still(at=(0.0, 0.0, height)), 40000, dt)[:, 2]
    time, falling = dt * np.arange(1, len(path) + 1), path > 8e-3
    first = int(np.argmin(falling))
    np.testing.assert_allclose(path[:first], height - 0.5 * G * time[:first] ** 2, atol=0.6 * G * dt * time[first])
    assert path.min() < -1e-3 and abs(path[-1]) < 1e-6
    tops = path[1:-1][(path[1:-1] > path[:-2]) & (path[1:-1] > path[2:])]
    assert len(tops) and tops.max() < 0.8 * height and (np.diff(tops) < 0.0).all()


def spectral_radius(given, stiff, damper, arm, added, dt):
    """Of the step of an organ on a linear foundation, with a spring and damper at `arm` that answers a step later."""
    made, columns = base(given), []
    for column in np.eye(15):
        at, turn, speed, rate, last = column.reshape(5, 3)
        now = still(at=at, turn=turn, bend=turn, speed=speed, rate=rate, shear=at * (1, 1, 0))
        place = at + np.cross(turn, arm)
        force = -stiff * place - damper * (place - last) / dt
        step(made, UP, now, tuple(force), tuple(np.cross(arm, force)), added, added, dt)
        columns.append(np.concatenate([now.at, now.turn, now.speed, now.rate, place]))
    return np.abs(np.linalg.eigvals(np.array(columns).T)).max()


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 4e-3])
def test_a_damped_contact_that_answers_a_step_later_is_stable_for_any_mass_and_stiffness(dt):
    """Eigenvalues of the coupled step; without the added inertia many are outside the unit circle."""
    rng, grown = np.random.default_rng(2), 0
    for _ in range(60):
        given = draw_organ(rng)._replace(attached=True, weight=0.0)
        stiff, damper, arm = 10.0 ** rng.uniform(1, 5), 10.0 ** rng.uniform(-2, 2), rng.normal(0.0, 0.03, 3)
        whole = dt * dt * (stiff + damper / dt)
        assert spectral_radius(given, stiff, damper, arm, (whole, whole * float(arm @ arm)), dt) < 1.0 + 1e-9
        grown += spectral_radius(given, stiff, damper, arm, (0.0, 0.0), dt) > 1.0 + 1e-9
    assert grown > 10


def test_the_stiffness_of_a_contact_is_that_of_finger_and_body_in_series_or_of_the_friction():
    tip, law = np.array([1.0, 26.2641, 1681.06, 0.0, 8.0]), np.array([257.0 * 21.0, 1.0, 0.0, 1e-3, 2e-3])
    s, dt = 1.2e-3, 1e-3
    force = 26.2641 / 1681.06 * np.expm1(1681.06 * s)
    finger = 26.2641 + 1681.06 * force + 8.0 * force / dt
    series = 1.0 / (1.0 / finger + 1.0 / (257.0 * 21.0))
    lose = np.zeros(4)
    assert contact_stiffness(force, s, 2e-3, tip, lose, law, dt) == approx(series, rel=1e-9)
    assert contact_stiffness(force, s, 2e-3, tip, lose, np.zeros(5), dt) == approx(finger, rel=1e-9)
    rough = np.array([0.0, 0.0, 3000.0, 1.4])
    assert contact_stiffness(force, s, 2e-3, tip, rough, law, dt) == approx(max(force * (3000 + 1400), series))
    assert contact_stiffness(0.0, 0.0, 0.0, tip, rough, law, dt) == 0.0
