"""The graphs with beam bundles: a sliding fingertip, and the kidney with only its body replaced."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Friction, Slip, Surface, unpack
from palpate.records.reader import Recording


def run(name, path, *overrides, duration=None, place="fused"):
    """The recorded bytes of each stream of a shipped run."""
    outcome = execute(find(name).but(overrides=overrides, duration=duration, record=path, place=place))
    assert outcome.result.ok, outcome.result.deaths
    payloads = {}
    for stream, _, payload in Recording(path).payloads():
        payloads.setdefault(stream, []).append(payload)
    return payloads


def decoded(streams, name, kind):
    return [unpack(b, kind) for b in streams[name]]


@pytest.fixture(scope="module")
def slide(tmp_path_factory):
    return run("fingertip-slide", tmp_path_factory.mktemp("slide") / "run.mcap")


def test_the_fingertip_presses_relaxes_and_lifts(slide):
    contact = decoded(slide, "finger.Contact", Contact)
    friction = decoded(slide, "finger.Friction", Friction)
    slip = decoded(slide, "finger.Slip", Slip)
    assert len(contact) == 5000
    assert contact[499].compression == approx(2e-3, abs=1e-5)
    force = np.array([c.force for c in contact])
    assert force[499] == force.max() and np.all(np.diff(force[501:1500]) <= 1e-9)
    tangential = np.array([f.force[1] for f in friction])
    assert not tangential[:1499].any()
    assert tangential[2999] == approx(0.7 * force[2999], rel=1e-3)
    assert np.all(np.diff(force[3000:]) <= 1e-9) and force[-1] == 0 and tangential[-1] == 0
    warned = next(k for k, s in enumerate(slip) if s.incipient)
    gross = next(k for k, s in enumerate(slip) if s.gross)
    assert 1500 < warned < gross - 300
    assert max(s.residual for s in slip) < 1e-5 and max(s.iterations for s in slip) < 30


def test_processes_send_the_same_bytes_as_one_process(slide, tmp_path):
    apart = run("fingertip-slide", tmp_path / "run.mcap", duration=1.8, place=None)
    for stream, sent in apart.items():
        assert sent == slide[stream][: len(sent)], stream


def test_the_slide_has_the_direction_of_the_scene(tmp_path):
    sets = ("scene.finger.direction='0 deg'", "scene.finger.hold='0 s'", "scene.finger.friction=0.3")
    streams = run("fingertip-slide", tmp_path / "run.mcap", *sets, duration=2.0)
    last = decoded(streams, "finger.Friction", Friction)[-1]
    force = decoded(streams, "finger.Contact", Contact)[-1].force
    assert last.force[0] == approx(0.3 * force, rel=1e-2)
    assert abs(last.force[1]) < 0.02 * last.force[0]


def test_one_line_replaces_the_body_of_the_kidney(tmp_path):
    """Only the body and the forces differ; all other nodes are unchanged."""
    forces = {}
    for body in ("MassSpring", "BeamBundle"):
        streams = run("kidney", tmp_path / f"{body}.mcap", f"tissue.use=deformation.{body}", duration=1.2)
        contact = decoded(streams, "contact", Contact)
        surface = decoded(streams, "tissue", Surface)
        force = np.array([c.force for c in contact])
        assert np.isfinite(force).all() and 0.05 < force.max() < 9
        assert max(len(s.nodes) for s in surface) > 5
        if body == "MassSpring":  # beams shear separately: their surface is smoothed, with a note
            assert all(s.limited == 0 for s in surface)
        forces[body] = force
    assert np.abs(forces["MassSpring"] - forces["BeamBundle"]).max() > 0.01
