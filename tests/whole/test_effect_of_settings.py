"""Each numeric setting of a shipped graph has an effect, or is refused, at 10 and 0.1 times its value."""

import random

import pytest
from effectless import HARDWARE, candidates, effectless

from palpate.launch.load.files import GRAPHS

SAMPLE = 4
RUN = sorted(file.stem for file in GRAPHS.glob("*.yaml") if file.stem not in HARDWARE)


def test_a_sample_of_the_settings_of_the_kidney_has_an_effect():
    known = list(candidates("kidney"))
    assert len(known) > 40
    assert effectless("kidney", random.Random(5).sample(known, SAMPLE)) == []


@pytest.mark.long
@pytest.mark.parametrize("graph", RUN)
def test_every_setting_has_an_effect(graph):
    assert effectless(graph, list(candidates(graph))) == []
