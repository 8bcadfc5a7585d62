"""The scene's list `organs`: lines repeated for each organ and each pair in reach, and what is wrong with a list."""

import re

import numpy as np
import pytest
from label_files import write_nifti

from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.plan import plan

BALL = {"surface": "sphere", "vertices": 600}


def scene(*organs, **more):
    return {"organs": list(organs), "tissue": {"friction": False, "young": 19e3}, **HAND, **more}


HAND = {"finger": {}, "sliding": {}, "hand": {"begin": [0, 0, 0.16], "path": []}, "between": {"reach": 6e-3}}


def ball(name, *place, **more):
    return {**BALL, "name": name, "position": list(place), **more}


def stack(*organs, **more):
    return load("stack", scene=scene(*organs, **more))


def senders(graph, node, port):
    return [edge.producer for edge in graph.nodes[node].edges if edge.port == port]


def test_each_organ_has_its_lines_and_each_pair_in_reach_a_contact():
    """Four balls of 42 mm in a row with gaps of 1 mm, and one far away."""
    names = "a", "b", "c", "d"
    row = [ball(name, 0, 0.043 * i, 0.1) for i, name in enumerate(names)]
    graph = stack(*row, ball("far", 0, 0, 0.2))
    contacts = [name for name, spec in graph.nodes.items() if name.startswith("between-") and spec.off is None]
    assert contacts == ["between-a-b", "between-b-c", "between-c-d"]
    left = "a-c", "a-d", "a-far", "b-d", "b-far", "c-far", "d-far"
    assert {name: why for name, why in plan(graph).skipped.items() if "friction" not in name} == {
        f"between-{pair}": f"{pair.replace('-', ' and ')} are farther apart than 6 mm (between.reach)" for pair in left
    }
    assert senders(graph, "b", "load") == ["spread-b", "side-b-a", "side-b-c"]
    assert senders(graph, "contact-b", "neighbour") == ["side-b-a", "side-b-c"]
    assert senders(graph, "between-b-c", "first") == ["spread-b", "side-b-a"]
    assert senders(graph, "between-b-c", "second") == ["spread-c", "side-c-d"]
    assert senders(graph, "far", "load") == ["spread-far"] and not senders(graph, "contact-far", "neighbour")
    assert senders(graph, "touch", "contact") == [f"contact-{name}" for name in (*names, "far")]
    assert graph.nodes["b"].settings["organ_loads"] == 2 and graph.nodes["b"].settings["position"] == [0, 0.043, 0.1]
    assert graph.nodes["between-b-c"].settings["first_organs"] == 1


def test_overrides_reach_the_parts_and_the_repeated_lines():
    """A position by override decides which pairs are in reach; a class and a setting of a repeated line."""
    given = scene(ball("a", 0, 0, 0.1), ball("b", 0, 0.06, 0.1))
    assert load("stack", scene=given).nodes["between-a-b"].off is not None
    near = "scene.b.surface.position=[0, 43 mm, 100 mm]"
    graph = load(
        "stack", scene=given, overrides=[near, "a.young=30 kPa", "b.use=deformation.Rigid", "between-a-b.cells=80"]
    )
    assert graph.nodes["between-a-b"].settings["cells"] == 80
    assert graph.nodes["a"].settings["young"] == 30e3 and graph.nodes["b"].use == "deformation.Rigid"


def test_tissues_are_those_of_the_list_or_of_the_scene():
    graph = stack(
        ball("a", 0, 0, 0.1),
        ball("b", 0, 0.1, 0.1, tissue="liver-human"),
        ball("c", 0, 0.2, 0.1, tissue={"young": 5e3}),
    )
    young = [graph.nodes[name].settings["young"] for name in "abc"]
    assert young[0] == 19e3 and young[2] == 5e3 and 5e3 < young[1] < 7e3  # 3 x 2.09 kPa


def test_labels_of_a_segmentation_keep_their_places(tmp_path):
    """Two blocks of an image, one voxel of 2 mm apart, are organs of which the names are the labels."""
    image = np.zeros((24, 24, 30), np.uint8)
    image[4:20, 4:20, 4:14], image[4:20, 4:20, 15:26] = 1, 2
    write_nifti(tmp_path / "seg.nii", image, np.diag([2.0, 2.0, 2.0, 1.0]))
    file = str(tmp_path / "seg.nii")
    graph = load(
        "stack", scene=scene({"file": file, "label": 1, "name": "lower"}, {"file": file, "label": 2, "name": "upper"})
    )
    assert "between-lower-upper" in graph.nodes
    assert graph.nodes["lower"].settings["surface"].endswith(".ply")


@pytest.mark.parametrize(
    ("organs", "says"),
    [
        ([ball("a", 0, 0, 0.1), ball("b", 0, 0.039, 0.1)], "organs: a and b overlap by 2.87 mm at the start"),
        ([ball("a", 0, 0, 0.1), ball("a", 0, 0.05, 0.1)], "organs: an organ has the name 'a'"),
        ([ball("tissue", 0, 0, 0.1)], "organs: a part of the scene has the name 'tissue'"),
        ([ball("a b", 0, 0, 0.1)], "organs: found the name 'a b', expected letters, digits, _ and -"),
        ([{**BALL, "place": [0, 0, 0]}], "organs: found the key 'place'"),
        ([{"name": "a"}], "organs: expected either `file` or `surface` of each organ"),
        ([{"file": "missing.stl"}], "missing.stl"),
        ([3], "organs: found 3, expected {file: liver.stl, unit: mm}"),
        ([ball("a", 0, 0, 0.1, tissue=3)], "organs: found the tissue 3 of a, expected a name or a mapping"),
        ([ball("a", 0, 0, 0.1, tissue="lever-human")], "no tissue 'lever-human'"),
        ([], "organs: found [], expected a list of 1 to 16 organs"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_list_is_a_fault(organs, says):
    with pytest.raises(GraphError, match=re.escape(says)):
        stack(*organs)


def test_a_graph_and_a_scene_that_do_not_fit_together_are_reported():
    assert any("list `organs` reaches no node" in note for note in load("kidney", scene="stack").notes)
    with pytest.raises(GraphError, match="has lines for each organ, but the scene has no list `organs`"):
        load("stack", scene="kidney")


@pytest.mark.parametrize(
    "organs", ["[liver.obj, {surface: kidney}]", "[{surface: kidney, tissue: livr-human}]", "[{}]"]
)
def test_an_organ_that_cannot_be_read_causes_no_faults_of_lines_for_it(tmp_path, organs):
    scene = tmp_path / "mine.yaml"
    scene.write_text(f"extends: stack\norgans: {organs}\n")
    with pytest.raises(GraphError) as found:
        load("stack", scene=str(scene))
    assert [fault.place.file for fault in found.value.faults] == [str(scene)]
