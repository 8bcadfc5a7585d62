"""A force-torque sensor reports a known load in every orientation, and its imperfections have the stated size."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Pose
from palpate.nodes.base import effects, settings
from palpate.nodes.sensor.force_torque import ForceTorque

RATE = 1000.0


def contact(force=0.0, normal=(0.0, 0.0, 1.0), foot=(0.0, 0.0, 0.0), lateral=(0.0, 0.0, 0.0)):
    return Contact(foot=foot, normal=tuple(normal), force=force, compression=0.0, indentation=0.0,
                   compression_rate=0.0, indentation_rate=0.0, lateral_force=lateral)  # fmt: skip


def pose(position=(0.0, 0.0, 0.0)):
    return Pose(position=position, velocity=(0.0, 0.0, 0.0), dt=1e-3)


def reports(forces, friction=None, ticks=RATE, **settings):
    """Reported (forces, torques) [N], [N m] (n,3) for normal forces [N] (n,) along z at the sensor's origin."""
    bus = FakeBus(ForceTorque(lever=(0.0, 0.0, 0.0), **settings), ticks, pose=pose(), friction=friction)
    sent = bus.publish(*(contact(f) for f in forces))
    return np.array([m.force for m in sent]), np.array([m.torque for m in sent])


def test_a_tool_of_100_g_weighs_0981_newton_in_every_orientation():
    """200 random orientations; the centre is 40 mm in front of the sensor's origin."""
    rng = np.random.default_rng(1)
    for turn in Rotation.random(200, rng):
        node = ForceTorque(mass=0.1, centre=(0.0, 0.0, 0.04), orientation=tuple(turn.as_rotvec()))
        (sent,) = FakeBus(node, pose=pose()).publish(contact())
        weight = turn.inv().apply([0.0, 0.0, -0.981])
        assert np.linalg.norm(sent.force) == pytest.approx(0.981, rel=1e-12)
        assert sent.force == pytest.approx(weight, abs=1e-12)
        assert sent.torque == pytest.approx(np.cross([0.0, 0.0, 0.04], weight), abs=1e-12)
        assert not sent.saturated


def test_contact_lateral_force_and_friction_act_at_the_foot_of_the_contact():
    """Random loads against numpy and scipy."""
    rng = np.random.default_rng(2)
    for turn in Rotation.random(50, rng):
        normal, lever, foot, at = rng.standard_normal((4, 3))
        normal, lateral, rub = normal / np.linalg.norm(normal), rng.standard_normal(3), rng.standard_normal(3)
        node = ForceTorque(orientation=tuple(turn.as_rotvec()), lever=tuple(lever))
        friction = Friction(force=tuple(rub), bristle=(0.0, 0.0, 0.0), stick=False)
        bus = FakeBus(node, pose=pose(tuple(at)), friction=friction)
        (sent,) = bus.publish(contact(3.0, normal, tuple(foot), tuple(lateral)))
        load = 3.0 * normal + lateral - rub
        assert sent.force == pytest.approx(turn.inv().apply(load), abs=1e-12)
        arm = lever + turn.inv().apply(foot - at)
        assert sent.torque == pytest.approx(np.cross(arm, turn.inv().apply(load)), abs=1e-12)


def test_without_imperfections_the_report_is_the_load_of_the_same_tick():
    forces = np.linspace(0.0, 5.0, 20)
    force, torque = reports(forces)
    assert np.array_equal(force[:, 2], forces) and not force[:, :2].any() and not torque.any()


def test_every_imperfection_is_an_effect_that_is_off():
    node, switches = ForceTorque(), {e.name: e.setting for e in effects(ForceTorque)}
    assert set(switches) == {
        "crosstalk", "hysteresis", "low_pass", "bias", "drift", "noise", "saturation", "quantisation", "sampling",
        "delay",
    }  # fmt: skip
    assert all(getattr(node, setting) == 0.0 for setting in switches.values())
    assert {settings(ForceTorque)[s].default for s in switches.values()} == {0.0}


def test_noise_and_drift_have_the_stated_deviation():
    """20 s of 1 kHz: the deviation of noise is exact to 0.5 %, that of 240 walks to 5 %."""
    force, torque = reports(np.zeros(20000), noise=0.01, seed=3)
    assert force.std(axis=0) == pytest.approx(0.5, rel=0.03) and torque.std(axis=0) == pytest.approx(0.02, rel=0.03)
    assert np.abs(np.corrcoef(np.hstack([force, torque]).T) - np.eye(6)).max() < 0.04
    ends = [reports(np.zeros(601), ticks=10.0, drift=0.02, seed=s)[0][-1] for s in range(80)]
    assert np.std(ends) == pytest.approx(0.02 * 50.0, rel=0.15)  # after one minute
    again, other = (reports(np.zeros(50), noise=0.01, seed=s)[0] for s in (3, 4))
    assert np.array_equal(again, force[:50]) and not np.array_equal(again, other)


def test_hysteresis_encloses_a_loop_of_its_width():
    up = np.linspace(0.0, 10.0, 101)
    force, _ = reports(np.concatenate([up, up[::-1]]), hysteresis=0.02)
    rise, fall = force[:101, 2], force[101:, 2][::-1]
    assert (fall - rise)[40:60] == pytest.approx(np.full(20, 0.02 * 50.0), abs=1e-12)


def test_saturation_resolution_and_bias():
    forces = np.linspace(0.0, 100.0, 501)
    force, _ = reports(forces, saturation=1.0, resolution=1e-3)
    assert force.max() == 50.0 and np.abs(force[:, 2] - np.minimum(forces, 50.0)).max() <= 0.5 * 0.05 + 1e-9
    assert np.allclose(force / 0.05, np.round(force / 0.05), atol=1e-9)
    bus = FakeBus(ForceTorque(saturation=1.0), pose=pose())
    assert [m.saturated for m in bus.publish(contact(10.0), contact(60.0), contact(10.0))] == [False, True, False]
    force, torque = reports([0.0], bias=0.01)
    assert np.abs(force) == pytest.approx(np.full((1, 3), 0.5)) and np.abs(torque) == pytest.approx(
        np.full((1, 3), 0.02)
    )


def test_crosstalk_is_at_most_its_share_of_the_full_scale():
    largest = 0.0
    for seed in range(40):
        force, torque = reports([50.0], crosstalk=0.02, seed=seed)
        assert force[0, 2] == 50.0
        shown = np.r_[force[0, :2] / 50.0, torque[0] / 2.0]
        assert np.abs(shown).max() <= 0.02
        largest = max(largest, np.abs(shown).max())
    assert largest > 0.018


def test_low_pass_sampling_and_delay_in_time():
    force, _ = reports(np.r_[0.0, np.ones(100)], cutoff=10.0)
    after = np.arange(1, 101) / RATE
    assert force[1:, 2] == pytest.approx(1.0 - np.exp(-2.0 * np.pi * 10.0 * after), abs=1e-12)
    ramp = np.arange(100.0)
    force, _ = reports(ramp, rate=1000.0)
    assert np.array_equal(force[:, 2], ramp)
    force, _ = reports(ramp, delay=0.025)
    assert np.array_equal(force[25:, 2], ramp[:75]) and not force[:25].any()
    force, _ = reports(ramp, rate=100.0)
    assert np.array_equal(force[:, 2], ramp // 10 * 10)
    force, _ = reports(ramp, rate=100.0, delay=0.005)
    assert np.array_equal(force[5:, 2], ramp[:95] // 10 * 10)


def test_a_delay_that_holds_too_many_samples_has_a_note():
    bus = FakeBus(ForceTorque(delay=1.0), 4000.0, pose=pose())
    bus.publish(*(contact(1.0) for _ in range(1100)))
    assert any("holds more than 1024 samples" in note for note in bus.node.notes())
