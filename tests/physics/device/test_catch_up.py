"""A pose that follows a device after an outage, where few samples arrive."""

import numpy as np
import pytest

from palpate.compiler.fields import blank_record
from palpate.physics.device.catch_up import CATCH_UP, LAG, begin, catch_up

SPEED = 0.3  # [m/s]


@pytest.mark.parametrize("seed", range(20))
def test_the_pose_comes_nearer_and_does_not_pass_a_device_between_samples(seed):
    """A step of 27 to 80 ms from rest: it passed the device by 4.5 mm, into the organ, where 12 N acted and not 4."""
    rng = np.random.default_rng(seed)
    state, at, velocity = blank_record(CATCH_UP), rng.uniform(-0.03, 0.03, 3), rng.uniform(-0.3, 0.3, 3)
    begin(state, 0.0, 0.0, 0.0)
    dt = rng.uniform(0.027, 0.08)
    place = np.array(catch_up(state, tuple(at), tuple(velocity), SPEED, dt)[:3])
    behind = at - velocity * dt  # the way to the device at the begin of the step
    assert np.linalg.norm(place - at) < np.linalg.norm(behind)
    assert (place - at) @ behind <= 1e-12


@pytest.mark.parametrize("rate", [250.0, 1000.0, 10_000.0])
def test_a_pose_near_a_device_at_constant_speed_follows_it_exponentially(rate):
    """From d, small against `SPEED` LAG, it is behind by d exp(-t/LAG); of first order in the step."""
    state, velocity, d, dt = blank_record(CATCH_UP), np.array([0.02, 0.0, -0.01]), 1e-3, 1.0 / rate
    begin(state, 0.0, 0.0, 0.0)
    state["velocity"] = velocity
    behind = []
    for k in range(round(0.09 * rate)):
        at = np.array([d, 0.0, 0.0]) + velocity * dt * (k + 1)
        behind.append(np.linalg.norm(at - catch_up(state, tuple(at), tuple(velocity), SPEED, dt)[:3]))
    t = dt * np.arange(1, len(behind) + 1)
    late = t > 0.045  # its velocity has risen, at `LARGEST`
    assert np.polyfit(t[late], np.log(np.array(behind)[late]), 1)[0] == pytest.approx(
        -1.0 / LAG, rel=0.6 * dt / LAG + 0.02
    )
