"""One finger on several organs: contact.Sum, and the graph `organs`."""

import numpy as np
import pytest
from pytest import approx

from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Force, Friction, unpack
from palpate.nodes.contact.sum import Sum
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

LEFT, RIGHT = (-0.6, 0.0, 0.8), (0.6, 0.0, 0.8)


def contact(force, normal, depth=1e-3, along=(0.0, 0.0, 0.0)):
    still = {"compression_rate": 0.0, "indentation_rate": 0.0, "lateral_force": along, "stored": (force * depth,)}
    return Contact(foot=normal, normal=normal, force=force, compression=depth, indentation=2 * depth, **still)


def rubbing(*force):
    return Friction(force=force, bristle=(0.0, 0.0, 0.0), stick=True)


def test_a_single_touched_organ_gives_the_contact():
    one, none = contact(0.7, LEFT), contact(0.0, RIGHT)
    ((received, _),) = FakeBus(Sum()).publish([none, one])
    assert (received.force, received.normal, received.foot, received.compression) == (0.7, LEFT, LEFT, 1e-3)


def test_contacts_with_two_organs_are_added():
    bus = FakeBus(Sum(), friction=[rubbing(0.1, 0.0, 0.0), rubbing(0.0, 0.2, 0.0)])
    ((received, rubbed),) = bus.publish([contact(0.6, LEFT, 1e-3, (0.0, 0.1, 0.0)), contact(0.3, RIGHT, 4e-3)])
    total = 0.6 * np.array(LEFT) + 0.3 * np.array(RIGHT)
    assert received.force * np.array(received.normal) == approx(total)
    assert np.linalg.norm(received.normal) == approx(1.0)
    assert received.lateral_force == approx((0.0, 0.1, 0.0)) and rubbed.force == approx((0.1, 0.2, 0.0))
    assert received.compression == approx((0.6 * 1e-3 + 0.3 * 4e-3) / 0.9)
    assert received.stored[0] == approx(0.6e-3 + 1.2e-3)


def test_cancelling_forces_and_a_missing_friction_are_valid():
    bus = FakeBus(Sum(), friction=[None, rubbing(0.0, 0.2, 0.0)])
    ((received, rubbed),) = bus.publish([contact(0.5, (1.0, 0.0, 0.0)), contact(0.5, (-1.0, 0.0, 0.0))])
    assert received.force == 0.0 and received.normal == (1.0, 0.0, 0.0) and rubbed.force == (0.0, 0.2, 0.0)


def test_a_finger_moves_from_one_organ_to_the_other_without_a_jump(tmp_path):
    sets = ("scene.surface.vertices=1500", "scene.liver-surface.vertices=1500")
    assert execute(
        find("organs").but(record=tmp_path / "organs.mcap", place="fused", duration=3.3, overrides=sets)
    ).result.ok
    recording = Recording(tmp_path / "organs.mcap")
    sent: dict[str, list] = {}
    for name, _, payload in recording.payloads():
        kind = {"contact": Contact, "friction": Friction, "controller": Force}.get(name.partition("-")[0])
        if kind:
            sent.setdefault(name, []).append(unpack(payload, kind))
    kidney, liver = (np.array([c.force for c in sent[f"contact-{organ}"]]) for organ in ("kidney", "liver"))
    hand = np.array([f.force for f in sent["controller"]])
    assert kidney[500:900].min() > 0.5 and liver[500:900].max() == 0.0
    both = slice(1900, 2200)
    assert kidney[both].min() > 0.1 and liver[both].min() > 0.1
    assert liver[2700:3200].min() > 0.5 and kidney[2700:3200].max() == 0.0
    pushed = [f * np.array(c.normal) for f, c in zip(kidney, sent["contact-kidney"], strict=True)]
    pushed = np.array(pushed) + [f * np.array(c.normal) for f, c in zip(liver, sent["contact-liver"], strict=True)]
    rubbed = sum(np.array([f.force for f in sent[f"friction-{organ}"]]) for organ in ("kidney", "liver"))
    assert np.abs(hand - pushed + rubbed)[both].max() < 0.01 * np.abs(hand[both]).max()
    assert np.abs(np.diff(hand, axis=0)).max() < 0.15
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok, report.first


def test_an_organ_missing_in_the_sum_is_an_error(tmp_path):
    path = tmp_path / "organs.yaml"
    path.write_text("extends: organs\nnodes: {both: {in: {contact: contact-kidney}}}\n")
    with pytest.raises(GraphError) as error:
        load(path)
    assert "node 'contact-liver': its force reaches no controller" in str(error.value)
    assert "contact.Sum" in str(error.value)
