"""Two or three organs on foundations that touch each other, without a finger: nodes stepped one by one."""

import numpy as np
import pytest
from pytest import approx

from palpate.messages.tissue import Support
from palpate.physics.bodies.floating.turning import spin
from palpate.studies.organ_stacks import FREE, RADIUS, Row, ball, body

G = 9.80665


def raised(height, count=200):
    """A support that rises in `count` steps and stays."""
    return [
        Support(displacement=(0.0, 0.0, height * share), velocity=(0.0, 0.0, 0.0))
        for share in np.linspace(0.0, 1.0, count)
    ]


@pytest.mark.parametrize("stiffness, retardation, rigid, friction, rate", [
    (300.0, 0.0, False, 0.0, 1000), (300.0, 20e-3, False, 0.5, 1000), (3e4, 0.0, False, 0.0, 250),
    (0.0, 0.0, True, 0.0, 250), (0.0, 0.0, True, 0.5, 10000),
])  # fmt: skip
def test_an_organ_that_hits_another_keeps_momentum_and_angular_momentum_and_loses_energy(
    stiffness, retardation, rigid, friction, rate
):
    """Both free, the first one is off the middle of the second, so that both rotate. Their foundations of 1e-6 N/m
    change the momentum of 10 mN s by less than 1e-10."""
    surfaces = ball(43e-3, 6e-3), ball(0.0)
    bodies = [body(each, stiffness, retardation, rigid) for each in surfaces]
    organs = Row(bodies, [FREE | {"mass": 0.05}, FREE | {"mass": 0.2}], friction)
    organs.moving()[0].own["motion"]["speed"] = (0.0, 0.0, -0.2)
    before, (linear, angular) = organs.total_energy(), organs.momenta()
    course = []
    for _ in range(rate // 10):
        organs.run(1, 1.0 / rate)
        course.append(organs.total_energy())
    after, spun = organs.momenta()
    np.testing.assert_allclose(after, linear, atol=1e-10)
    np.testing.assert_allclose(spun, angular, atol=1e-10)
    assert max(course) <= before * (1.0 + 1e-9) and organs.history[-1][0][0].generated < 1e-3 * before
    second = organs.moving()[1].own["motion"]
    assert second["speed"][2] < -0.03 and np.abs(second["rate"]).max() > 0.1


def test_an_elastic_impact_approaches_the_closed_form_with_the_rate():
    """Springs without damping: v_1 = (m_1 - m_2)/(m_1 + m_2) v and v_2 = 2 m_1/(m_1 + m_2) v, to first order in T."""
    errors = []
    for rate in (1000, 2000, 4000):
        organs = Row([body(ball(43e-3)), body(ball(0.0))], [FREE | {"mass": 0.05}, FREE | {"mass": 0.2}])
        organs.moving()[0].own["motion"]["speed"] = (0.0, 0.0, -0.2)
        organs.run(rate // 8, 1.0 / rate)
        speeds = [each.own["motion"]["speed"][2] for each in organs.moving()]
        errors.append(abs(speeds[0] - 0.12) / 0.2)
        assert organs.contacts[0]._held["members.0.pair.first"].any() and organs.history[-1][0][0].force == 0.0
    assert errors[0] < 0.15 and [errors[0] / errors[1], errors[1] / errors[2]] == approx([2.0, 2.0], rel=0.2)


def test_the_forces_of_stacked_foundations_add_exactly():
    """The uppermost is pressed down by its motion: at rest F = K_2 d_2 + K_3 d_3 of the springs below."""
    bodies = [body(ball(2 * 42.4e-3)), body(ball(42.4e-3)), body(ball(0.0))]
    two, three = ({"mass": 0.1, "stiffness": k, "damping": 3.0} for k in (150.0, 400.0))
    organs = Row(bodies, [raised(-3e-3), two, three])
    upper, lower = organs.run(3000)
    sinks = [-each.own["motion"]["at"][2] for each in organs.moving()]
    assert upper.force > 0.1 and min(sinks) > 5e-5
    assert upper.resultant[2] == approx(150.0 * sinks[0] + 400.0 * sinks[1], rel=1e-9)
    assert lower.resultant[2] == approx(400.0 * sinks[1], rel=1e-9)
    # the springs of the cells: the same force as without foundations under the motion of the organs against each other
    still = Row(bodies[:2], [raised(-3e-3 + sinks[0]), None]).run(300)[0]
    assert upper.force == approx(still.force, rel=1e-9)


def test_a_weight_on_springs_that_another_organ_supports_rests_with_the_sum_of_both():
    """A loose organ of 1.96 N sinks by 2 mm at rest; a fixed one below takes over what it rises by."""
    mass, stiffness = 0.2, 0.2 * G / 2e-3
    organs = Row(
        [body(ball(42.4e-3)), body(ball(0.0))],
        [{"mass": mass, "stiffness": stiffness, "damping": 5.0, "attached": False}, raised(2e-3)],
    )
    (answer,) = organs.run(3000)
    rise = organs.moving()[0].own["motion"]["at"][2]
    assert 1e-4 < rise < 2e-3 and answer.force > 0.05
    assert answer.resultant[2] == approx(stiffness * rise, rel=1e-9)  # W - N = K rise


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_exchanged_organs_have_the_same_bits(friction):
    bodies = [body(ball(43e-3, 5e-3), 500.0, 5e-3), body(ball(0.0), 250.0)]
    given = [{"mass": 0.05, "stiffness": 40.0}, {"mass": 0.12, "stiffness": 90.0, "attached": False}]
    found = []
    for exchanged in (False, True):
        organs = Row(bodies, given, friction, exchanged)
        organs.moving()[0].own["motion"]["speed"] = (0.05, 0.02, -0.3)
        organs.run(150)
        found.append(organs)
    one, other = found
    assert max(a[0].force for a, _ in one.history) > 0.1
    for (answers, supports), (others, sides) in zip(one.history, other.history, strict=True):
        assert np.array_equal(np.negative(answers[0].resultant), others[0].resultant)
        assert np.array_equal(answers[0].torques, others[0].torques[::-1])
        assert np.array_equal(np.negative(answers[0].normal), others[0].across_normal)
        assert np.array_equal(np.negative(answers[0].across_normal), others[0].normal)
        for a, b in zip(supports, sides, strict=True):
            assert a.displacement == b.displacement and np.array_equal(a.rotation, b.rotation)


@pytest.mark.parametrize("attached", [True, False])
def test_a_foundation_of_1_gn_per_m_is_a_fixed_organ(attached):
    """Within 2e-6 of the greatest force: 1 N moves it by 1 nm, of the millimetre by which the organs yield. A loose one
    counts as free until it is pressed: a force of the first step that touches is 1e-4 of that late."""
    bodies, forces = [body(ball(42.4e-3), 300.0, 20e-3), body(ball(0.0), 300.0, 20e-3)], []
    for given in (None, {"mass": 0.13, "stiffness": 1e9, "damping": 4.0, "attached": attached}):
        organs = Row(bodies, [raised(-3e-3), given])
        organs.run(400)
        forces.append(np.array([answers[0].force for answers, _ in organs.history]))
    assert forces[0].max() > 0.2
    np.testing.assert_allclose(forces[1], forces[0], rtol=2e-6, atol=(2e-6 if attached else 1e-4) * forces[0].max())


@pytest.mark.parametrize("light", [1.0, 1e-3])
@pytest.mark.parametrize("rate", [250, 10000])
def test_a_light_organ_between_heavy_ones_passes_on_their_momentum(light, rate):
    """Balls of 1 kg, `light` and 1 kg, all free: the first hits the second, which hits the third. Their dampers stop
    the relative motion within 1 ms: all then move with v m_1/(m_1 + m_2 + m_3), with the energy of this motion."""
    bodies = [body(ball(height), 1e3, 1.0) for height in (42.3e-3, 0.0, -42.05e-3)]
    organs = Row(bodies, [FREE | {"mass": mass} for mass in (1.0, light, 1.0)])
    organs.moving()[0].own["motion"]["speed"] = (0.0, 0.0, -0.2)
    before, (linear, angular) = organs.total_energy(), organs.momenta()
    for _ in range(rate // 20):
        organs.run(1, 1.0 / rate)
        assert organs.total_energy() <= before * (1.0 + 1e-9)
        assert min(each.gap for each in organs.history[-1][0]) > -1e-6
    after, spun = organs.momenta()
    np.testing.assert_allclose(after, linear, atol=1e-9)
    np.testing.assert_allclose(spun, angular, atol=1e-9)
    together = 0.2 / (2.0 + light)
    assert [-each.own["motion"]["speed"][2] for each in organs.moving()] == approx([together] * 3, rel=0.02)
    assert organs.total_energy() == approx(0.5 * (2.0 + light) * together**2, rel=0.02)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("bears", [FREE, {"stiffness": 500.0, "damping": 2.0}])
def test_organs_move_as_their_contacts_expect_where_the_forces_turn_from_step_to_step(bears, friction):
    """A ball of 6 g between two others, hit off its centre, at 250 Hz: forces turn by up to 0.2 rad per step. With the
    forces of the last step along the directions of this one, the motion was up to 6 mm from what they expected."""
    bodies = [body(ball(43e-3, 6e-3), 3e3, 5e-3), body(ball(0.0), 3e3, 5e-3), body(ball(-43e-3), 3e3)]
    organs = Row(bodies, [bears | {"mass": mass} for mass in (0.3, 0.006, 0.2)], friction)
    organs.moving()[0].own["motion"]["speed"] = (0.2, 0.1, -0.8)
    organs.run(1, 4e-3)
    touched = 0
    for _ in range(25):
        before = [(each.own["motion"]["at"].copy(), each.own["motion"]["turn"].copy()) for each in organs.moving()]
        answers = organs.run(1, 4e-3)
        members = organs.contacts[0].own["members"]
        for k, pair in enumerate(organs.pairs):
            for side, organ in enumerate(pair):
                (at, turn), motion = before[organ], organs.moving()[organ].own["motion"]
                expected = members[k]["by"][side]
                np.testing.assert_allclose(expected[:3], motion["at"] - at, atol=1e-13)
                np.testing.assert_allclose(expected[3:], spin(tuple(turn), tuple(motion["turn"] - turn)), atol=1e-12)
        touched += answers[0].force > 0.1 and answers[1].force > 0.1
    assert touched > 3


def draw(rng, count):
    """Balls in a row, on random foundations, one of which may be fixed: 10 g to 2 kg on 10 N/m to 1 MN/m."""
    aside = rng.uniform(-8e-3, 8e-3)
    surfaces = [ball(np.sqrt((2 * RADIUS) ** 2 - aside**2) + 1e-3, aside), ball(0.0), ball(-43e-3)][:count]
    bodies, given = [], []
    for k, surface in enumerate(surfaces):
        past = rng.choice([0.0, 10.0 ** rng.uniform(-4, -1)])
        bodies.append(body(surface, 10.0 ** rng.uniform(1.5, 5), past, rng.random() < 0.3))
        mass, stiffness = 10.0 ** rng.uniform(-2, 0.3), 10.0 ** rng.uniform(1, 6)
        damping = rng.choice([0.0, 10.0 ** rng.uniform(-2, 2)])
        given.append(
            None if k and rng.random() < 0.25 else {
                "mass": mass, "stiffness": stiffness, "damping": damping, "attached": bool(rng.integers(2)),
                "friction": rng.choice([0.0, 0.3]),
            }
        )  # fmt: skip
    return bodies, given


@pytest.mark.parametrize("seed, count", [(1, 2), (2, 2), (3, 3), (4, 3)])
def test_random_organs_that_hit_each_other_gain_no_energy(seed, count):
    """250 Hz to 10 kHz, soft and rigid, with and without friction: energy of all organs, their foundations and weights
    is at most that at the start, and no organ is deeper in another than 0.1 mm."""
    rng, touched = np.random.default_rng(seed), 0
    for _ in range(10):
        bodies, given = draw(rng, count)
        organs = Row(bodies, given, rng.choice([0.0, 0.3, 1.0]))
        rate = rng.choice([250, 1000, 10000], p=[0.45, 0.45, 0.1])
        motion = organs.moving()[0].own["motion"]
        motion["at"], motion["speed"] = (0.0, 0.0, 2e-3), (rng.uniform(-0.2, 0.2), 0.0, -rng.uniform(0.05, 1.0))
        before = organs.total_energy()
        for _ in range(int(min(max(0.12 * rate, 50), 400))):
            organs.run(1, 1.0 / rate)
            assert organs.total_energy() <= before * (1.0 + 1e-9)
            assert min(each.gap for each in organs.history[-1][0]) > -1e-4
        touched += max(each.force for answers, _ in organs.history for each in answers) > 0.0
    assert touched > 5
