"""The afferents of a finger that slides over a nodule, in the shipped graph."""

import json

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run.execute import execute
from palpate.messages import Spikes
from palpate.physics.afferents.published import TYPES
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.views.page.reel import RecordingSource
from palpate.views.pictures import afferents
from palpate.views.pictures.touch import TouchStreams


def planned(*overrides, scene="afferents"):
    return plan(find("nodule").but(scene=scene, overrides=overrides).load())


def test_afferents_run_if_the_scene_has_them_and_a_node_reads_them():
    assert {"stress", "afferents"} <= set(planned().order)
    assert not {"stress", "afferents"} & set(planned(scene="nodule").order)
    assert not {"stress", "afferents"} & set(planned("wanted=[controller]", "log=null").order)
    assert "afferents" in planned("wanted=[afferents]", "log=null").order


def run(path, *overrides, place="fused"):
    outcome = execute(find("nodule").but(scene="afferents", record=path, place=place, overrides=overrides))
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("afferents")
    return run(folder / "hard.mcap"), run(folder / "plain.mcap", "tissue.nodule_radius=0")


def counts(recording, begin, end):
    """Spikes of each type from messages within this time [s]."""
    kind = TouchStreams(recording).make("afferents").make_population().kind
    units = [m.unit for m in recording.messages("afferents") if begin <= m.time * 1e-9 < end]
    return np.bincount(kind[np.concatenate(units)], minlength=len(TYPES))


@pytest.mark.long
def test_sa1_fire_more_over_the_nodule_and_ra1_at_onset_and_end(felt):
    hard, plain = felt
    assert counts(hard, 1.6, 2.1)[0] > 1.08 * counts(plain, 1.6, 2.1)[0]
    assert counts(hard, 0.7, 0.95)[1] < 0.1 * counts(hard, 0.25, 0.5)[1]
    assert counts(hard, 2.6, 2.85)[1] > 100


@pytest.mark.long
def test_the_recording_is_small_and_replays_bit_for_bit(felt):
    hard, _ = felt
    assert "stress" not in hard.streams or not list(hard.messages("stress"))
    report = verify(hard, plan_of(hard))
    assert report.ok and report.nodes["spread"].checked


@pytest.mark.long
def test_a_process_per_node_sends_the_same_spikes(felt, tmp_path):
    apart = run(tmp_path / "apart.mcap", place=None)
    same = [[(m.tick, m.unit.tolist(), m.moment.tolist()) for m in r.messages("afferents")] for r in (apart, felt[0])]
    assert same[0] == same[1]


@pytest.mark.long
def test_picture_and_page_show_the_spikes(felt):
    touch = TouchStreams(felt[0])
    drawn = afferents.draw_picture(touch)
    assert drawn is not None and "464" in drawn.get_suptitle()
    source = RecordingSource(felt[0].path)
    head = source.begin(0, "x")
    source.close()
    start = head.index(b"{")
    about = json.JSONDecoder().raw_decode(head[start:].decode("utf-8", "replace"))[0]
    assert len(about["receptors"]["x"]) == 464
    assert isinstance(next(felt[0].messages("afferents")), Spikes)
