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
