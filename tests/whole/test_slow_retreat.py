"""A slow retreat from tissue, and tissue that comes to the hand: it feels the force of the contact until it ends."""

import numpy as np
import pytest
from streams import read

import palpate
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Force
from palpate.records.reader import Recording


def lack(path, *sets, duration):
    """The contact force [N] (k), and what the hand lacks of it along the normal."""
    launch = find("kidney").but(duration=duration, record=path, place="fused", overrides=sets)
    assert execute(launch).result.ok
    touched, given = read(Recording(path), contact=Contact, controller=Force)
    force = np.array([c.force for c in touched])
    return force, force - np.einsum("ij,ij->i", [f.force for f in given], [c.normal for c in touched])


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle", "ReducedFE"])
@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_the_hand_loses_no_force_in_a_retreat_of_6_mm(body, seconds, tmp_path):
    """A Falcon renders 1667 N/m; the kidney under a finger has less than 400."""
    out = f"{{to: [0, 0, 0.1035], time: {seconds}}}"
    path = f"[{{to: [0, 0, 0.0975], time: 0.4}}, {{hold: 0.2}}, {out}, {{hold: 0.3}}]"
    sets = f"tissue.use=deformation.{body}", f"scene.hand.path={path}", "scene.surface.vertices=2000"
    force, lacks = lack(tmp_path / "run.mcap", *sets, duration=0.9 + seconds)
    assert force.max() > 1.0
    assert lacks.max() < 0.05 and np.mean(lacks[force > 0.2]) < 0.005


@pytest.mark.parametrize("period", [2.0, 4.0])
def test_the_hand_feels_an_organ_that_rises_and_sinks_under_it(period, tmp_path):
    breath = f"{{breathing: {{moves: [tissue], amplitude: [0, 0, 12 mm], period: {period}, waveform: breathing}}}}"
    sets = f"scene.motions={breath}", "scene.hand.path=[{to: [0, 0, 0.1005], time: 0.5}, {hold: 8}]"
    force, lacks = lack(tmp_path / "run.mcap", *sets, "scene.surface.vertices=2000", duration=period + 1.0)
    assert force.max() > 2.0
    assert lacks.max() < 0.06 and np.mean(lacks[force > 0.2]) < 0.01


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")  # notes of settings that a body does not take
@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle", "ReducedFE"])
@pytest.mark.parametrize(("seconds", "apart"), [(0.5, 8e-3), (2.0, 6e-3)])
def test_a_finger_at_rest_feels_tissue_rise_that_another_one_leaves(body, seconds, apart):
    """It did not feel up to 0.35 of 0.61 N, as the motion of the finger did not pay for it."""
    x, z = -0.012, 0.1037 + 0.15 * apart
    away = f"{{to: [{x - apart}, 0, 0.11], time: {seconds}}}"
    other = f"[{{to: [{x - apart}, 0, 0.098], time: 0.4}}, {{hold: 0.4}}, {away}, {{hold: 1}}]"
    path = f"[{{hold: 0.4}}, {{to: [{x}, 0, {z}], time: 0.3}}, {{hold: 9}}]"
    sets = [
        f"tissue.use=deformation.{body}", "scene.surface.vertices=2000", "scene.nodule.nodule_radius=0",
        f"scene.middle.begin=[{x - apart}, 0, 0.11]", f"scene.middle.path={other}",
        f"scene.index.begin=[{x}, 0, 0.11]", f"scene.index.path={path}",
    ]  # fmt: skip
    wanted = ["contact-1.force", "contact-1.normal", "controller-1.force"]
    found = palpate.Ensemble("palpate-two", 1, {}, wanted, duration=1.8 + seconds, sets=sets).run(quiet=True)
    force, normal, given = (np.asarray(found[name])[0] for name in wanted)
    lacks = force - np.einsum("ij,ij->i", given, normal)
    assert force[800] < 0.75 * force[-1] and force[-1] > 0.3
    assert lacks.max() < 0.02 and np.mean(lacks[800:]) < 0.002
