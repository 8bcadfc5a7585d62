"""The force under the shipped encoder, at rates from 500 Hz to 10 kHz, against exact positions at the same rate."""

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

POINT = (-0.02, 0.003, 0.0985)
COUNT = 60e-6  # [m]


def press(folder, rate, *sets):
    """Forces [N] (k,3) of the controller and of friction: a finger goes to a point in 0.4 s and stays for 0.6 s."""
    path = f"[{{to: {list(POINT)}, time: 0.4}}, {{hold: 0.6}}]"
    place = (f"scene.hand.begin=[{POINT[0]}, {POINT[1]}, 0.116]", f"scene.hand.path={path}")
    launch = find("kidney").but(
        record=folder / "run.mcap", place="fused", duration=1.0, wanted=("controller", "friction"),
        overrides=(f"rate={rate}", "scene.surface.vertices=1500", *place, *sets),
    )  # fmt: skip
    assert execute(launch).result.ok
    recording = Recording(folder / "run.mcap")
    return [recording.columns(node)["force"] for node in ("controller", "friction")]


@pytest.mark.parametrize("rate", [500, 1000, 2000, 5000, 10_000])
def test_the_encoder_changes_the_force_by_2_percent_at_every_rate(tmp_path, rate):
    force, rubbed = press(tmp_path, rate)
    exact, rubs = press(tmp_path, rate, "device.resolution=0", "finger.resolution=0")
    peak = np.linalg.norm(exact, axis=1).max()
    assert abs(np.linalg.norm(force, axis=1).max() - peak) < 0.02 * peak
    last = round(0.2 * rate)
    held, wanted = np.linalg.norm(force[-last:].mean(axis=0)), np.linalg.norm(exact[-last:].mean(axis=0))
    assert abs(held - wanted) < 0.02 * wanted
    noise, smooth = (np.sqrt(np.mean(np.sum(np.diff(f, axis=0) ** 2, axis=1))) for f in (force, exact))
    assert noise - smooth < 0.005 * peak
    assert np.sqrt(np.sum(np.var(force[-last:], axis=0))) < 0.01
    # Friction at rest is a spring along the surface, 500/m times the force: half a count cannot be seen.
    assert np.linalg.norm((rubbed - rubs)[-last:].mean(axis=0)) < 500.0 * 0.5 * COUNT * wanted
