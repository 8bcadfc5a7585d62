"""The setting `bodies` of contact.Between, which names classes: only bodies are made, for any text."""

import json

import pytest

from palpate.nodes.base import SettingError
from palpate.nodes.contact import Between

BALL = {"surface": "sphere", "vertices": 600, "position": (0.0, 0.0, 0.1), "rotation": (0.0, 0.0, 0.0)}


@pytest.mark.parametrize("use", ["basis_store", "ReducedAnswer", "MassSpring.__init__", "subprocess", "OnSurface", ""])
def test_no_other_code_is_called(use):
    side = {"use": use, "settings": {}, "surface": BALL}
    with pytest.raises(SettingError, match="expected a body of"):
        Between(bodies=json.dumps([side, side])).start()


@pytest.mark.parametrize("text", ["[", "kidney", "{]"])
def test_text_that_is_not_json_is_refused(text):
    with pytest.raises(SettingError, match="no JSON"):
        Between(bodies=text).start()


@pytest.mark.parametrize(("cells", "coarse"), [(16, True), (64, False)])  # 2.6 and 1.2 mm apart
def test_candidates_that_are_far_apart_are_noted_with_what_they_resolve(cells, coarse):
    linear = {"exponent": 1.0, "damping": 0.0, "retardation": 0.02}
    ball = {"surface": "sphere", "vertices": 3000, "rotation": (0.0, 0.0, 0.0)}  # 21 mm
    sides = [
        {"use": "MassSpring", "settings": linear, "surface": {**ball, "position": (0.0, 0.0, z)}}
        for z in (0.0, 42.5e-3)
    ]
    node = Between(bodies=json.dumps(sides), cells=cells)
    node.start()
    found = [note for note in node.notes() if "candidates are" in note]
    assert len(found) == coarse
    assert not coarse or "2.6 mm apart, so that patches narrower than 11 mm are too stiff: more `cells`" in found[0]
