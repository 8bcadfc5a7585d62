"""The runs with which the pages of the gallery begin (docs/site/touches.py)."""

import importlib.util
from pathlib import Path

import pytest

from palpate.launch.load.launchfile import find

FILE = Path(__file__).parents[2] / "docs" / "site" / "touches.py"


@pytest.fixture(scope="module")
def touches():
    spec = importlib.util.spec_from_file_location("touches", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["neighbours", "pinch-liver", "stack", "organs"])
def test_a_large_run_begins_with_a_lighter_one_and_offers_itself(touches, name):
    light, exact = touches.places(find(name), name)
    assert exact.launch == find(name) and light.scene != exact.scene and light.scene.startswith("fast: ")
    uses = {node: spec.use for node, spec in light.launch.load().nodes.items()}  # raises if a setting is unknown
    assert set(uses) == set(exact.launch.load().nodes)
    assert "deformation.ReducedFE" not in uses.values()


def test_the_other_runs_are_as_they_are(touches):
    (place,) = touches.places(find("kidney"), "kidney")
    assert place.launch == find("kidney") and place.scene == ""
    assert set(touches.LIGHT) == {"neighbours", "pinch-liver", "stack", "organs"}
