"""Thumb and index finger grip the kidney: the graph `pinch`, its grip and load force, and its replay."""

import numpy as np
import pytest
from graphs_for_runs import until_it_has
from pytest import approx

from palpate.engine.slot import _forces
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Force
from palpate.messages.grip import Grip
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

SMALL = "scene.surface.vertices=1500"


def run(path, *sets, watch=lambda _: None, **changes):
    launch = find("pinch").but(record=path, place="fused", overrides=(SMALL, *sets), **changes)
    outcome = execute(launch, watch=watch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    return run(tmp_path_factory.mktemp("pinch") / "pinch.mcap")


def at(recording, time, *streams):
    row = round(time * 1000)
    return [{name: values[row] for name, values in recording.columns(stream).items()} for stream in streams]


def test_the_fingers_grip_lift_and_slip(held):
    grip = held.columns("grip")
    hold, pulled = (at(held, time, "grip")[0] for time in (1.3, 2.2))
    assert 0.8 < hold["grip"] < 2.0 and hold["load"] < 0.25 < pulled["load"]
    assert (pulled["margin"] > 0.3).all()
    slips = grip["ratio"][2400:3000]
    assert grip["margin"][2400:3000].min() < 0.1 and 0.5 < slips.max() < 0.75
    assert not grip["normal"][-1].any() and grip["grip"][-1] == 0.0


def test_the_forces_on_the_hands_match_the_grip(held):
    grip, thumb, index = at(held, 1.3, "grip", "contact-thumb", "contact-index")
    assert grip["normal"] == approx([thumb["force"], index["force"]])
    forces = [at(held, 1.3, f"controller-{finger}")[0]["force"] for finger in ("thumb", "index")]
    between = thumb["foot"] - index["foot"]
    between /= np.linalg.norm(between)
    assert grip["grip"] == approx((forces[0] - forces[1]) @ between / 2, rel=0.05)


def test_the_live_view_shows_force_and_signed_margin_of_each_finger():
    sent = Grip(grip=1.0, load=0.2, ratio=0.1, normal=(1.0, 2.0), tangential=(0.0, 0.5), margin=(-0.1, 1.0))
    printed = _forces(sent)
    assert printed["normal[1]"] == 2.0 and printed["margin[0]"] == -0.1 and printed["grip"] == 1.0
    assert _forces(Force(force=(1.0, 2.0, 2.0), state="contact", energy=0.0)) == {"force": 3.0}


def test_it_replays_bit_for_bit(held):
    report = verify(held, plan_of(held), tolerance=0.0)
    assert report.ok and report.complete, report.first


@pytest.mark.parametrize("body", ["MassSpring", pytest.param("ReducedFE", marks=pytest.mark.long)])
def test_the_energy_balance_of_both_fingers_closes_and_no_part_generates_energy(tmp_path, body):
    quick = [f"device-{finger}.speed_factor=2" for finger in ("thumb", "index")]
    sets = "scene.energy.ledger=true", f"tissue.use=deformation.{body}", *quick
    recording = run(tmp_path / "books.mcap", *sets, duration=2.0)
    messages = list(recording.messages("ledger"))
    last = messages[-1]
    kinds = [(part, kind) for part in ("fingertip", "tissue", "friction") for kind in ("stored", "dissipated")]
    assert last.hand > 5e-3 and not last.tripped
    held = sum(getattr(last, f"{part}_{kind}") for part, kind in kinds)
    assert last.hand - last.controller - last.sampling == approx(held + last.unexplained, rel=1e-9)
    assert abs(last.unexplained) < 1e-3 * last.hand
    assert max(m.generated for m in messages) < 0.05 * last.hand
    assert last.fingertip_stored + last.friction_stored < 1e-6 and last.friction_dissipated > 1e-3


def test_two_emulated_falcons_grip_the_kidney_and_the_recording_replays(tmp_path):
    sets = (SMALL, "device-thumb.port=emulator", "device-index.port=emulator")
    launch = find("falcons").but(record=tmp_path / "falcons.mcap", place="fused", overrides=sets, duration=None)
    outcome = execute(launch, watch=until_it_has(grip=("steps", 1600)))
    assert outcome.result.ok, outcome.result.deaths
    recording = Recording(tmp_path / "falcons.mcap")
    assert (recording.columns("grip")["normal"].max(axis=0) > 0.5).all()
    for finger in ("thumb", "index"):
        assert recording.columns(f"device-{finger}")["homed"].any()
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok, report.first


def test_a_run_on_the_real_clock_replays_bit_for_bit(tmp_path):
    recording = run(tmp_path / "real.mcap", clock="real", duration=None, watch=until_it_has(grip=("steps", 900)))
    assert max(recording.columns("grip")["grip"]) > 0.5
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok, report.first
