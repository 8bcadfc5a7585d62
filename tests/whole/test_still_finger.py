"""A finger held still: force noise from the encoder's steps, without a filter."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

HOLD = Path(__file__).parents[2] / "benchmarks" / "hold.py"
EXACT = ("device.resolution=0", "finger.resolution=0", "controller.resolution=0")


def force(folder, point, *sets):
    """The force [N] (k,3) on a hand that moves to a point [m] in 0.4 s and stays there for 1 s."""
    path = f"[{{to: {list(point)}, time: 0.4}}, {{hold: 1.0}}]"
    sets = (f"scene.hand.begin=[{point[0]}, {point[1]}, 0.116]", f"scene.hand.path={path}", *sets)
    launch = find("kidney").but(record=folder / "run.mcap", overrides=("scene.surface.vertices=1500", *sets),
                                place="fused", duration=1.4, wanted=("controller",))  # fmt: skip
    assert execute(launch).result.ok
    return Recording(folder / "run.mcap").columns("controller")["force"]


def noise(force, rate=1000, seconds=0.5, trend=False):
    """RMS [N] of a force (k,3) over its last seconds, about its mean or, with `trend`, about a parabola, which removes
    the creep of a relaxing body."""
    last = force[-round(seconds * rate) :]
    assert np.linalg.norm(last.mean(axis=0)) > 0.3
    t = np.vander(np.linspace(-1.0, 1.0, len(last)), 3 if trend else 1)
    left = last - t @ np.linalg.lstsq(t, last, rcond=None)[0]
    return float(np.sqrt(np.square(left).sum(axis=1).mean()))


@pytest.mark.parametrize("body", ["MassSpring", "ReducedFE"])
@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0945), (-0.02, 0.003, 0.0985), (0.01, -0.004, 0.096)])
def test_the_encoder_adds_little_noise_to_a_still_finger(tmp_path, point, body):
    assert noise(force(tmp_path, point, f"tissue.use=deformation.{body}")) < 0.015


@pytest.mark.parametrize("rate", [500, 5000])
def test_the_noise_is_small_at_other_rates(tmp_path, rate):
    assert noise(force(tmp_path, (0.0, 0.0, 0.0945), f"rate={rate}"), rate) < 0.015


@pytest.mark.parametrize("body", ["MassSpring", "Rigid"])
def test_with_exact_positions_the_force_is_constant(tmp_path, body):
    assert noise(force(tmp_path, (0.0, 0.0, 0.0955), f"tissue.use=deformation.{body}", *EXACT)) < 1e-3


@pytest.mark.parametrize("point", [(-0.02, 0.003, 0.0985), (0.01, -0.004, 0.096)])
def test_beams_come_to_rest_with_exact_positions(tmp_path, point):
    """They relax for seconds, and the finger moves with them: a slow motion, not an oscillation."""
    assert noise(force(tmp_path, point, "tissue.use=deformation.BeamBundle", *EXACT), trend=True) < 5e-3


HELD = [  # body, height of the hand over the kidney's middle [m], rate [Hz]; the finger touches at 0.109
    ("BeamBundle", 0.0935, 1000),
    ("Rigid", 0.0955, 1000),
    *(
        pytest.param(body, height, rate, marks=pytest.mark.long)
        for body in ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
        for height in (0.098, 0.0955, 0.0935)
        for rate in (500, 1000, 5000)
    ),
]


@pytest.mark.parametrize(("body", "height", "rate"), HELD)
def test_every_body_is_quiet_under_a_still_finger_with_the_encoder(tmp_path, body, height, rate):
    """Without a filter, about a parabola, because beams continue to relax."""
    held = force(tmp_path, (0.0, 0.0, height), f"tissue.use=deformation.{body}", f"rate={rate}")
    assert noise(held, rate, trend=True) < 0.03


@pytest.mark.parametrize("rate", [1000, *(pytest.param(rate, marks=pytest.mark.long) for rate in (500, 2000, 5000))])
def test_a_finger_that_slid_on_to_a_rigid_ball_rests_within_a_second(tmp_path, rate):
    """After it stops it creeps and slips, for a time that depends on where it lies between two counts."""
    for shift in 60e-6 * np.random.default_rng(1).random((3, 2)):
        furrow, ball = (f"[{shift[0]}, {y + shift[1]}, {z}]" for y, z in ((0.030, 0.088), (0.0515, 0.1)))
        path = f"[{{to: {furrow}, time: 0.4}}, {{to: {ball}, time: 0.8, shape: linear}}, {{hold: 1.2}}]"
        sets = (f"scene.hand.path={path}", "scene.hand.begin=[0, 0.030, 0.114]", f"rate={rate}")
        bodies = ("kidney.use=deformation.Rigid", "liver.use=deformation.Rigid")
        launch = find("organs").but(record=tmp_path / "run.mcap", overrides=(*sets, *bodies), place="fused",
                                    duration=2.4, wanted=("controller",))  # fmt: skip
        assert execute(launch).result.ok
        assert noise(Recording(tmp_path / "run.mcap").columns("controller")["force"], rate, 0.2) < 0.03


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("body", ["BeamBundle", "ReducedFE", "Rigid"])
@pytest.mark.parametrize("graph", ["fingertip", "nodule", "remote", "organs", "pinch", "palpate-two"])
def test_a_still_finger_is_quiet_in_every_graph_with_every_body(graph, body):
    """On its shipped touch. MassSpring and the other rates: benchmarks/hold.py."""
    for hold in runpy.run_path(str(HOLD))["run"](graph, body, 1000).holds.values():
        assert hold.held > 0.2 and hold.noise < 0.03


@pytest.mark.parametrize(("body", "reported"), [("MassSpring", 0), ("Rigid", 1)])
def test_a_contact_too_stiff_for_the_device_is_reported_once(body, reported):
    """The shipped kidney loses less than 5 % of its force to the device's limit, a rigid body most of it."""
    launch = find("kidney").but(place="fused", duration=0.9, overrides=(f"tissue.use=deformation.{body}",))
    notes = execute(replace(launch, record=None)).result.notes
    assert sum("the hand feels a softer one" in text for text in notes) == reported
