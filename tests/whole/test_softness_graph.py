"""The shipped softness graph as a whole run."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Pins, unpack
from palpate.physics.display.pins import pin_grid
from palpate.physics.display.shape_display import pad_contact, pad_displacement
from palpate.records.reader import Recording

R = np.hypot(*pin_grid(6, 6, 2e-3).reshape(-1, 2).T).reshape(6, 6)


def run(folder, duration, **more):
    launch = find("softness").but(duration=duration, record=folder / "run.mcap", **more)
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    payloads: dict[str, list[bytes]] = {}
    for name, _, payload in Recording(folder / "run.mcap").payloads():
        payloads.setdefault(name, []).append(payload)
    return payloads


def test_the_launch_file_is_the_whole_press():
    launch = find("softness")
    assert isinstance(launch, LaunchFile) and launch.duration == 5.0
    assert list(launch.load().nodes) == ["sensor", "display"]


def test_the_shipped_press_stays_inside_the_theory(tmp_path):
    sent = [unpack(m, Pins) for m in run(tmp_path, 5.0, place="fused")["display"]]
    assert len(sent) == 5000 and all(pins.valid for pins in sent) and max(pins.heights.max() for pins in sent) > 0.9e-3


def test_pins_and_actuator_follow_a_press_of_4_newton(tmp_path):
    streams = run(tmp_path, 2.5, place="fused", overrides=("scene.press.forces=[0, 4, 4, 0]",))
    forces = np.array([unpack(m, Contact).force for m in streams["sensor"]])
    pins = [unpack(m, Pins) for m in streams["display"]]
    assert forces.max() == 4.0
    top = pad_contact(4.0, 15e3)
    assert pins[-1].heights == approx(pad_displacement(R, top)) and pins[-1].actuator == approx(float(top.approach))
    # At first contact the fingerpad deforms faster than the actuators move; they catch up within 0.2 s.
    state = pad_contact(forces[200:, None, None], 15e3)
    assert np.array([p.heights for p in pins[200:]]) == approx(pad_displacement(R, state), abs=1e-6)


@pytest.mark.parametrize("overrides", [(), ("scene.pins.rows=3", "scene.pins.rise_time=50 ms")])
def test_placement_does_not_change_a_byte(tmp_path, overrides):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    fused = run(tmp_path / "a", 0.3, place="fused", overrides=overrides)
    apart = run(tmp_path / "b", 0.3, overrides=overrides)
    assert fused == apart and len(fused["display"]) == 300
