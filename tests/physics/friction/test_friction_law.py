"""A friction law takes one file: this one is written into a folder and runs in the kidney graph."""

import sys
from textwrap import dedent

import numpy as np
import pytest
from added_laws import DAHL
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Proximity
from palpate.nodes.friction import node_of
from palpate.records.reader import Recording

NODE = """

    from palpate.nodes.friction import node_of

    Sliding = node_of(Dahl, "Sliding", __name__)
"""


def slide(node, steps=400):
    up, here = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    slip = {"slip": (0.03, 0.04, 0.0), "coordinates": (0.0, 0.0), "element": 0, "gap": 0.0, "approach": 2e-3}
    press = {"force": 2.0, "compression": 1e-3, "indentation": 1e-3, "compression_rate": 0.0, "indentation_rate": 0.0}
    bus = FakeBus(node, proximity=Proximity(foot=here, normal=up, **slip))
    return bus.publish(*[Contact(foot=here, normal=up, **press)] * steps)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    assert len(DAHL.splitlines()) <= 40
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for name in [n for n in sys.modules if n.rpartition(".")[2] == "dahl"]:
        del sys.modules[name]


def test_a_law_in_a_separate_file_is_a_node(folder):
    (folder / "dahl.py").write_text(DAHL)
    import dahl

    answers = slide(node_of(dahl.Dahl)(mu=0.6))
    assert answers[-1].force == approx((0.72, 0.96, 0.0), rel=1e-3) and answers[0].stick


def test_a_law_of_another_folder_runs_in_the_kidney_graph(folder):
    (folder / "dahl.py").write_text(DAHL + dedent(NODE))
    path = "[{to: [-0.02, 0, 0.098], time: 0.15}, {to: [0.0, 0, 0.097], time: 0.2}]"
    sets = ("friction.use=dahl.Sliding", "friction.mu=0.3", "scene.surface.vertices=1500")
    sets += ("scene.hand.begin=[-0.02, 0, 0.111]", f"scene.hand.path={path}")
    launch = find("kidney").but(record=folder / "run.mcap", overrides=sets, place="fused", duration=0.35)
    outcome = execute(launch)
    assert outcome.result.ok, [str(death) for death in outcome.result.deaths]
    recording = Recording(folder / "run.mcap")
    friction, normal = recording.columns("friction")["force"], recording.columns("contact")["force"]
    share = np.linalg.norm(friction[200:], axis=1) / normal[200:]
    assert 0.2 < share.max() <= 0.3 * (1 + 1e-9)
