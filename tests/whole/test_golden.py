"""Golden recordings: the shipped loop still computes the same messages.

A failure means that a change has altered a force. If this is intended, make the recordings again
(`python tests/golden/make.py`) and describe it in the CHANGELOG.
"""

import json
from pathlib import Path

import pytest

from palpate.engine.provenance import rounding
from palpate.records.differences import ELSEWHERE
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

GOLDEN = sorted((Path(__file__).parents[1] / "golden").glob("*.mcap"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_a_golden_recording_is_reproduced(path):
    recording = Recording(path)
    elsewhere = rounding(recording.about)
    report = verify(recording, plan_of(recording), tolerance=ELSEWHERE if elsewhere else 0.0)
    assert report.ok and report.complete, f"{report.first}; recorded elsewhere: {elsewhere or 'no'}"
    assert sum(node.checked for node in report.nodes.values()) > 100


def test_the_golden_recordings_are_small_and_contain_a_touch():
    assert {path.stem for path in GOLDEN} == {"plane", "kidney", "smooth", "live"}
    assert sum(path.stat().st_size for path in GOLDEN) < 2_000_000
    for path in GOLDEN:
        recording = Recording(path)
        assert recording.complete and recording.columns("contact")["force"].max() > 0.05
        assert str(Path.home()) not in json.dumps(recording.about)
