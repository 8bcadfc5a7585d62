"""A body with a `rank` is found in all lists of bodies; it takes only a file in nodes/deformation."""

import sys

import pytest

from palpate.launch.load.launchfile import find
from palpate.nodes import deformation
from palpate.studies.accuracy import methods
from palpate.studies.tune import candidates

SOFTER = """
from typing import Annotated

from palpate.nodes.deformation.mass_spring import MassSpring


class Softer(MassSpring):
    rank = 2
    stiffness: Annotated[float, "N/m^n"] = 1e3


class Unranked(MassSpring):
    pass
"""


@pytest.fixture
def softer(tmp_path, monkeypatch):
    (tmp_path / "softer.py").write_text(SOFTER)
    monkeypatch.setattr(deformation, "__path__", [*deformation.__path__, str(tmp_path)])
    yield
    sys.modules.pop("palpate.nodes.deformation.softer", None)
    vars(deformation).pop("softer", None)


def test_bodies_are_sorted_by_rank_and_a_rank_is_not_inherited():
    assert list(deformation.bodies()) == ["deformation.ReducedFE", "deformation.BeamBundle", "deformation.MassSpring"]


def test_a_body_with_a_rank_is_a_candidate_and_a_method_of_the_bench(softer):
    assert list(deformation.bodies())[1:3] == ["deformation.BeamBundle", "deformation.Softer"]
    assert any(one.overrides == {"tissue.use": "deformation.Softer"} for one in candidates(find("kidney").load()))
    names = [method.name for method in methods.standard()]
    assert names.count("deformation.Softer") == 1 and not any("Unranked" in name for name in names)
