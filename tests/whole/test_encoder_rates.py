"""The force with the shipped encoder at rates from 500 Hz to 10 kHz, compared with exact positions at the same rate."""

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

POINT = (-0.02, 0.003, 0.0985)
FAR, LIGHT = (-0.03, 0.004, 0.0975), (0.008, -0.004, 0.1015)
STROKE = (0.006, -0.003, 0.0)  # [m]
COUNT = 60e-6  # [m]
BRISTLES, MU = 500.0, 0.7  # [1/m], [1] sigma_0 and g at rest in the kidney


def press(folder, rate, point, stroke, *sets):
    """Forces [N] (k,3) of the controller and of friction: a finger moves to a point in 0.2 or 0.4 s, with a stroke of
    0.2 s in the first case, and stays for 0.6 s."""
    end = [round(x + d, 6) for x, d in zip(point, stroke or (0.0, 0.0, 0.0), strict=True)]
    moves = f"{{to: {list(point)}, time: 0.2}}, {{to: {end}, time: 0.2, shape: linear}}"
    path = f"[{moves if stroke else f'{{to: {end}, time: 0.4}}'}, {{hold: 0.6}}]"
    place = (f"scene.hand.begin=[{point[0]}, {point[1]}, 0.116]", f"scene.hand.path={path}")
    launch = find("kidney").but(
        record=folder / "run.mcap", place="fused", duration=1.0, wanted=("controller", "friction"),
        overrides=(f"rate={rate}", "scene.surface.vertices=1500", *place, *sets),
    )  # fmt: skip
    assert execute(launch).result.ok
    recording = Recording(folder / "run.mcap")
    return [recording.columns(node)["force"] for node in ("controller", "friction")]


def long(*case):
    return pytest.param(*case, marks=pytest.mark.long)


@pytest.mark.parametrize(
    ("rate", "point", "stroke", "worn", "body"),
    [
        *((rate, POINT, None, 0.0, "MassSpring") for rate in (500, 1000, 2000, 5000, 10_000)),
        (1000, FAR, None, 1.0, "MassSpring"),
        (1000, LIGHT, STROKE, 1.0, "MassSpring"),
        (5000, POINT, None, 1.0, "ReducedFE"),
        (500, POINT, None, 1.0, "BeamBundle"),
        *(long(rate, FAR, None, 1.0, "MassSpring") for rate in (500, 5000, 10_000)),
        *(
            long(rate, point, stroke, 1.0, body)
            for body in ("MassSpring", "BeamBundle", "ReducedFE")
            for rate in (500, 1000, 5000, 10_000)
            for point, stroke in ((LIGHT, STROKE), (POINT, STROKE), (POINT, None))
        ),
    ],
)
def test_the_encoder_changes_the_force_by_2_percent_at_every_rate(tmp_path, rate, point, stroke, worn, body):
    """worn: counts of path by which friction may appear to have slid farther."""
    use = f"tissue.use=deformation.{body}"
    force, rubbed = press(tmp_path, rate, point, stroke, use)
    exact, rubs = press(tmp_path, rate, point, stroke, use, "device.resolution=0", "finger.resolution=0")
    peak = np.linalg.norm(exact, axis=1).max()
    assert abs(np.linalg.norm(force, axis=1).max() - peak) < 0.02 * peak
    last = round(0.2 * rate)
    held, wanted = np.linalg.norm(force[-last:].mean(axis=0)), np.linalg.norm(exact[-last:].mean(axis=0))
    assert abs(held - wanted) < 0.02 * wanted
    noise, smooth = (np.sqrt(np.mean(np.sum(np.diff(f, axis=0) ** 2, axis=1))) for f in (force, exact))
    assert noise - smooth < 0.005 * peak
    assert np.sqrt(np.sum(np.var(force[-last:], axis=0))) < 0.01
    # Friction at rest is a spring along the surface with stiffness sigma_0 times the force, and relaxes by sigma_0/g of
    # the path. Half a count of position and one count of path are not observable.
    friction = rubs[-last:].mean(axis=0)
    unseen = BRISTLES * COUNT * (0.5 * wanted + worn * np.linalg.norm(friction) / MU)
    assert np.linalg.norm(rubbed[-last:].mean(axis=0) - friction) < unseen
