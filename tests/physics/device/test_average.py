"""The moving average of eight points: against numpy's convolution and the published gain, delay and resolution."""

import math

import numpy as np
import pytest
from falcon_arrays import inverse
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import DeviceState
from palpate.nodes.base import SettingError
from palpate.nodes.kinematics import Cartesian, FalconKinematics
from palpate.physics.device.average import MOST, PUBLISHED
from palpate.physics.device.falcon import FALCON, HOME

FS = 1025.0  # [Hz] mean update rate of the kidney study
COUNT = 60e-6  # [m] its device's resolution


def follow(places, rate=FS, points=PUBLISHED):
    """Positions and velocities (n,3) of a node for positions (n,3)."""
    bus = FakeBus(Cartesian(average=points), rate=rate)
    poses = bus.publish(*[DeviceState(position=tuple(place)) for place in places.tolist()])
    return np.array([pose.position for pose in poses]), np.array([pose.velocity for pose in poses])


@pytest.mark.parametrize("points", [1, 2, 8, 17])
def test_position_and_velocity_are_the_means_of_numpy(points):
    rng = np.random.default_rng(points)
    places = np.cumsum(rng.normal(size=(120, 3)) * 1e-4, axis=0)
    seen, speeds = follow(places, 1000.0, points)
    mean = np.array([np.convolve(column, np.full(points, 1.0 / points), "valid") for column in places.T]).T
    assert seen[points - 1 :] == approx(mean, abs=1e-15)
    differences = np.diff(places, axis=0) * 1000.0
    mean = np.array([np.convolve(column, np.full(points, 1.0 / points), "valid") for column in differences.T]).T
    assert speeds[points:] == approx(mean, abs=1e-12)
    # while the window fills, the means of what was read
    for k in range(1, points):
        assert seen[k - 1] == approx(places[:k].mean(axis=0), abs=1e-15)
        assert speeds[k] == approx(differences[:k].mean(axis=0), abs=1e-12)


def response(frequency):
    """Complex gain of position and velocity from a sinusoid; the second over i w."""
    count = round(20 * FS / frequency) + 200
    time = np.arange(count) / FS
    wave = np.exp(2j * math.pi * frequency * time)
    places = np.stack([1e-3 * wave.real, 1e-3 * wave.imag, np.zeros(count)], axis=1)
    seen, speeds = follow(places)
    x, v = (1e3 * (values[:, 0] + 1j * values[:, 1]) for values in (seen, speeds))
    late = slice(100, None)
    return np.mean(x[late] / wave[late]), np.mean(v[late] / (2j * math.pi * frequency * wave[late]))


def sinc(frequency):
    x = math.pi * frequency / FS
    return abs(math.sin(PUBLISHED * x) / (PUBLISHED * math.sin(x)))


@pytest.mark.parametrize("frequency", [5.0, 20.0, 30.0, 57.1, 100.0])
def test_gain_and_delay_are_those_of_the_mean(frequency):
    x, v = response(frequency)
    assert abs(x) == approx(sinc(frequency), rel=1e-6)
    assert -np.angle(x) == approx(2 * math.pi * frequency * 3.5 / FS, abs=1e-6)
    # the velocity: the mean of differences; a difference has the gain sin(x)/x and a delay of half a sample
    x = math.pi * frequency / FS
    assert abs(v) == approx(sinc(frequency) * math.sin(x) / x, rel=1e-6)
    assert -np.angle(v) == approx(2 * math.pi * frequency * 4.0 / FS, abs=1e-6)


def test_the_published_figures_hold():
    """-3 dB at 0.446 fs/8, not at the 110 to 160 Hz of the study, which are the nulls."""
    assert abs(response(0.44596 * FS / 8)[0]) == approx(10 ** (-3.0103 / 20), abs=1e-4)
    assert abs(response(FS / 8)[0]) < 1e-9
    assert math.degrees(-np.angle(response(30.0)[0])) == approx(36.9, abs=0.05)
    steady = np.zeros((100, 3))
    steady[50:, 0] = COUNT  # one count
    for points, step in ((1, 61.5e-3), (8, 7.69e-3)):
        assert follow(steady, points=points)[1].max() == approx(step, rel=1e-3)


def test_white_noise_of_the_position_falls_by_the_root_of_the_points():
    noise = np.random.default_rng(3).normal(size=(4000, 3)) * 1e-5
    raw, seen = follow(noise, points=1), follow(noise)
    assert raw[0].std() / seen[0][20:].std() == approx(math.sqrt(8), rel=0.03)
    assert raw[1].std() / seen[1][20:].std() == approx(8.0, rel=0.03)


def test_an_uneven_clock_adds_no_error_to_the_velocity():
    """The study's updates came at 878 to 1265 Hz. A constant speed is found exactly; last differences scatter."""
    rng = np.random.default_rng(4)
    bus, now, speeds = FakeBus(Cartesian(average=8)), 0, []
    for tick in range(1, 61):
        now += int(rng.uniform(0.79e6, 1.14e6))
        (pose,) = bus.publish(DeviceState(position=(0.05e-9 * now, 0.0, 0.0), tick=tick, time=now))
        speeds.append(pose.velocity[0])
    assert speeds[1:] == approx([0.05] * 59, rel=1e-9)


def test_a_jump_begins_a_new_average_and_a_rejected_sample_holds_it():
    """The pose then moves there at a bounded speed (nodes/device/test_device_outage.py)."""
    places = np.zeros((1600, 3))
    places[10] = 0.5  # one wrong sample
    places[20:] = (0.3, 0.0, 0.0)  # the encoders were reset
    seen, speeds = follow(places, 1000.0)
    assert (seen[:23] == 0.0).all() and seen[-1] == approx((0.3, 0.0, 0.0)) and (speeds[-1] == 0.0).all()
    assert np.abs(np.diff(seen, axis=0)).max() < 0.34e-3


def test_a_falcon_averages_the_positions_of_its_grip():
    angles = inverse(HOME)[0][:, 0] + FALCON.count * np.random.default_rng(5).integers(-3, 4, (40, 3))
    states = [DeviceState(joints=tuple(row)) for row in angles.tolist()]
    raw = FakeBus(FalconKinematics(average=1)).publish(*states)
    seen = FakeBus(FalconKinematics(average=8)).publish(*states)
    exact = FakeBus(FalconKinematics(resolution=0.0)).publish(*states)
    assert [pose.position for pose in raw] == [pose.position for pose in exact]
    mean = np.mean([pose.position for pose in raw[-8:]], axis=0)
    assert seen[-1].position == approx(mean, abs=1e-15)


def test_the_number_of_points_is_limited():
    for wrong in (-1, MOST + 1, 2.5):
        with pytest.raises(SettingError, match="average"):
            Cartesian(average=wrong)
