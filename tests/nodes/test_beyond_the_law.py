"""A fingertip pressed beyond its tissue: the force is reported as meaningless in run, replay and compare."""

import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Proximity, Surface
from palpate.nodes.contact import Series

PLATE = Surface(
    nodes=np.zeros(0, "<i4"), displacement=np.zeros((0, 3)), stiffness=1e9, exponent=1.0, damping=0.0,
    rest_indentation=0.0, previous_indentation=0.0,
)  # fmt: skip
DEEP = (
    "scene.surface.vertices=400",
    "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.094], time: 0.3}, {to: [0, 0, 0.110], time: 0.1}]",
)


def pressed(*depths, **settings):
    """Notes and conditions of a finger compressed by these depths [m], in order."""
    bus = FakeBus(Series(**settings), body=PLATE)
    printed = []
    for depth in depths:
        near = msgspec.structs.replace(Proximity.example(loaded=True), approach=depth, separation=0.0, tick=-1, time=-1)
        (contact,) = bus.publish(near)
        printed.append((bus.node.notes(), bus.node.condition(), contact))
    return printed


def test_a_compression_beyond_the_tissue_is_reported_once_with_its_force():
    printed = pressed(1e-3, 3.9e-3, 4.6e-3, 4.8e-3, *[1e-3] * 10)  # it recovers by 0.125 mm per step
    assert [len(notes) for notes, _, _ in printed] == [0, 0, 1] + [0] * 11
    assert [bool(condition) for _, condition, _ in printed][:4] == [False, False, True, True] and not printed[-1][1]
    (note,), _, contact = printed[2]
    assert "4.6 mm" in note and "4 mm thick" in note and f"{contact.force:.3g} N" in note and "meaningless" in note


@pytest.mark.parametrize("thickness, noted", [(6e-3, False), (2e-3, True), (0.0, False)])
def test_the_limit_is_the_thickness_of_the_scene(thickness, noted):
    assert bool(pressed(4.6e-3, thickness=thickness)[0][0]) is noted


def test_run_replay_and_compare_report_it(tmp_path):
    file = tmp_path / "touch.mcap"
    ran = execute(find("kidney").but(record=file, place="fused", duration=0.4, overrides=DEEP)).result
    assert ran.ok and not any("meaningless" in note for note in ran.notes)
    thin = ("scene.finger.thickness=0.5 mm", "scene.hand.begin=[0, 0, 0.108]")
    ran = execute(
        replace(find("kidney").but(place="fused", duration=0.4, overrides=(*DEEP, *thin)), record=None)
    ).result
    assert any("0.5 mm thick" in note for note in ran.notes)
    swap = ["--set", "tissue.use=deformation.Rigid", "--json"]
    data = json.loads(CliRunner().invoke(app, ["replay", str(file), *swap]).stdout)
    assert sum("4 mm thick" in note for note in data["notes"]) == 1
    data = json.loads(CliRunner().invoke(app, ["compare", str(file), *swap, "--no-pictures"]).stdout)
    same, rigid = data["variants"]
    assert not any("meaningless" in n for n in same["notes"]) and any("meaningless" in n for n in rigid["notes"])
    shown = CliRunner().invoke(app, ["compare", str(file), *swap[:2], "--no-pictures"]).output
    assert "B: Series: the fingertip is compressed" in " ".join(shown.split())
