"""One value of the scene, one unit: what stands in for another class, or shares a block with it, means the same."""

from itertools import combinations

import pytest

from palpate.engine.faults import GraphError
from palpate.engine.graph import sent_by
from palpate.launch.load.classes import catalogue
from palpate.launch.load.files import GRAPHS as GRAPHS_FOLDER
from palpate.launch.load.graph import load
from palpate.launch.load.values.shared_units import _meaning
from palpate.nodes.base import settings
from palpate.nodes.deformation import Rigid

GRAPHS = ("kidney", "nodule", "fingertip", "softness", "fingertip-slide")
LIVER = """
from typing import Annotated

from palpate.messages import Load, Surface
from palpate.nodes.base import Node


class Liver(Node):
    stiffness: Annotated[float, "{unit}"] = 1.0

    def step(self, load: Load, *, dt: float) -> Surface: ...
"""


def test_shipped_classes_that_can_stand_in_for_one_another_agree_on_units():
    for one, other in combinations([entry.cls for entry in catalogue()[0]], 2):
        if set(sent_by(one)) & set(sent_by(other)):
            mine, theirs = settings(one), settings(other)
            for name in mine.keys() & theirs.keys():
                assert _meaning(mine[name].unit) == _meaning(theirs[name].unit), (name, one, other)


@pytest.mark.parametrize("name", GRAPHS)
def test_every_block_of_the_shipped_scenes_means_one_thing(name):
    load(name)


@pytest.mark.parametrize("use", ["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
def test_the_one_line_swap_of_the_body_still_loads(use):
    load("kidney", overrides=[f"tissue.use=deformation.{use}"])


def test_a_rigid_plate_does_not_take_the_stiffness_of_the_tissue():
    given = load("kidney", overrides=["tissue.use=deformation.Rigid"]).nodes["tissue"].settings
    assert Rigid(**given).plate_stiffness == 1e9


@pytest.fixture
def liver(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(unit, name):
        (tmp_path / f"{name}.py").write_text(LIVER.format(unit=unit))
        return f"tissue.use={name}.Liver"

    return write


def test_a_swapped_in_class_with_another_unit_is_refused_with_place_and_cure(liver):
    with pytest.raises(GraphError) as error:
        load("kidney", overrides=[liver("N/m", "liver_a")])
    text = str(error.value)
    for word in (
        "tissue.stiffness",
        "3000.0",
        "N/m for Liver",
        "N/m^n for MassSpring",
        "kidney.yaml",
        "Write its unit",
    ):
        assert word in text, text


def test_a_value_with_its_unit_or_on_the_nodes_own_line_is_taken(liver):
    swap = liver("N/m", "liver_b")
    said = load("kidney", overrides=[swap, "scene.tissue.stiffness='3 kN/m'"]).nodes["tissue"].settings
    own = load("kidney", overrides=[swap, "tissue.stiffness=2000"]).nodes["tissue"].settings
    assert said["stiffness"] == 3000.0 and own["stiffness"] == 2000.0


def test_a_swapped_in_class_with_the_same_unit_takes_the_value(liver):
    given = load("kidney", overrides=[liver("N/m^n", "liver_c")]).nodes["tissue"].settings
    assert given["stiffness"] == 3000.0


def test_two_nodes_that_share_a_block_in_different_units_are_refused(tmp_path):
    graph = tmp_path / "g.yaml"
    graph.write_text(
        "extends: kidney\nscene: {loop: {resolution: 1.0e-4}}\n"
        "nodes:\n  device: {with: [$hand, $loop]}\n  controller: {with: $loop}\n"
    )
    with pytest.raises(GraphError, match="rad for Simulated"):
        load(graph, scene={"extends": "kidney", "loop": {"resolution": 1e-4}})


def test_a_graph_and_a_scene_of_ones_own_are_not_held_to_classes_that_they_never_name(liver, tmp_path):
    use = liver("N/m", "liver_d").partition("=")[2]
    (tmp_path / "mine.yaml").write_text("extends: kidney\ntissue: {stiffness: 12}\n")
    kidney = (GRAPHS_FOLDER / "kidney.yaml").read_text().replace("scene: kidney", "scene: mine.yaml")
    (tmp_path / "graph.yaml").write_text(kidney.replace("deformation.MassSpring", use))
    assert load(tmp_path / "graph.yaml").nodes["tissue"].settings["stiffness"] == 12.0
