"""A finger held still on the kidney: what is left of the encoder's steps in the force."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

HIGH = butter(4, 40.0, "highpass", fs=1000.0, output="sos")
"""Over the whole hold: the ends of a window that the force creeps through are no oscillation of 40 Hz."""


def press(folder, point, *sets, told=0):
    """The recording of a hand that goes to a point [m] in 0.4 s and stays there for 1 s, in which so many notes say
    that it cannot be shown."""
    path = f"[{{to: {list(point)}, time: 0.4}}, {{hold: 1.0}}]"
    sets = (f"scene.hand.begin=[{point[0]}, {point[1]}, 0.116]", f"scene.hand.path={path}", *sets)
    launch = find("kidney").but(record=folder / "run.mcap", overrides=("scene.surface.vertices=1500", *sets),
                                place="fused", duration=1.4, wanted=("controller",))  # fmt: skip
    result = execute(launch).result
    assert result.ok and sum("the hand feels a softer one" in note for note in result.notes) == told
    return Recording(folder / "run.mcap")


def noise(folder, point, *sets):
    """Root mean square [N] above 40 Hz of the force on a hand that stays at a point [m], over its last half second."""
    force = press(folder, point, *sets).columns("controller")["force"]
    assert np.linalg.norm(force[-512:].mean(axis=0)) > 0.5
    return float(np.sqrt(np.square(sosfiltfilt(HIGH, force, axis=0)[-512:]).sum(axis=1).mean()))


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0945), (-0.02, 0.003, 0.0985), (0.01, -0.004, 0.096)])
def test_a_finger_held_still_hardly_feels_the_encoder(tmp_path, point):
    assert noise(tmp_path, point) < 0.015
    assert noise(tmp_path, point, "device.resolution=0") < 1e-3


@pytest.mark.parametrize("height", [0.1035, 0.102, 0.1005])
def test_a_finger_held_still_on_a_rigid_plate_comes_to_rest(tmp_path, height):
    """At 1.4, 2.0 and 2.7 N, where the fingertip is as stiff as the loop may show."""
    assert noise(tmp_path, (0.0, 0.0, height), "tissue.use=deformation.Rigid") < 0.015


@pytest.mark.parametrize("height", [0.098, 0.0955])
def test_a_finger_pressed_on_a_rigid_plate_harder_than_the_loop_may_show_swings_by_a_few_counts(tmp_path, height):
    """At 3.8 and 5.0 N (docs/equations/controller.md). Counts of the encoder make it: measured exactly it rests."""

    def swing(*sets):
        run = press(tmp_path, (0.0, 0.0, height), "tissue.use=deformation.Rigid", *sets, told=1)
        place, force = run.columns("finger")["position"][-512:], run.columns("controller")["force"][-512:]
        return float(np.ptp(place[:, 2])), float(np.ptp(force[:, 2]))

    place, force = swing()
    assert place < 0.4e-3 and force < 2.2
    place, force = swing("device.resolution=0", "finger.resolution=0")
    assert place < 5e-6 and force < 0.02


@pytest.mark.parametrize("point", [(-0.02, 0.003, 0.0985), (0.01, -0.004, 0.096)])
def test_beams_come_to_rest_under_a_finger_that_is_measured_exactly(tmp_path, point):
    """They relax for seconds, and the finger goes on with them; that is a slow motion, not an oscillation."""
    exact = ("tissue.use=deformation.BeamBundle", "device.resolution=0", "finger.resolution=0")
    assert noise(tmp_path, point, *exact) < 1e-3
