"""The switches of a scene, the keys of `when:`, are true or false: in YAML, --set, Python and ensembles."""

import random
from pathlib import Path

import numpy as np
import pytest
import yaml

import palpate
from palpate.engine.faults import Faults, GraphError, Location
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.launch.load.scene import Scene, condition
from palpate.launch.load.values.source import YamlSource, parse
from palpate.physics.errors import PalpateError

WRONG = (
    "n", "y", "N", "nein", "ja", "'no'", "'off'", "'false'", "'true'", "'yes'", "'on'", "t", "f", "disabled", "none",
    "0", "1", "-1", "0.0", "0.5", "1e3", "3 mm", "null", "''", "' '", "[]", "[true]", "{}", "{on: true}", "Falsch",
    "falsee",
)  # fmt: skip
RIGHT = {"true": True, "yes": True, "on": True, "True": True, "ON": True, "false": False, "no": False, "Off": False}


def switches(graph):
    """Path of each switch of a loaded graph."""
    when = {spec.when for spec in graph.nodes.values()} - {None, "True", "False"}
    return sorted({text.removeprefix("not ").lstrip("$") for text in when})


def scene_of(graph):
    """The name of the scene of a shipped graph."""
    given = yaml.safe_load((GRAPHS / f"{graph}.yaml").read_text())
    return Path(given["scene"]).stem if "scene" in given else scene_of(given["extends"])


NAMES = [file.stem for file in sorted(GRAPHS.glob("*.yaml"))]


@pytest.mark.parametrize("form", ["tissue.friction", "not tissue.friction", "$tissue.friction"])
def test_a_switch_takes_booleans_alone(form):
    """31 values that are no boolean, and 8 spellings of one, in each form of the condition."""
    for text in (*WRONG, *RIGHT):
        value = parse(text, "scene.yaml").data
        faults = Faults()
        scene = Scene(YamlSource({"tissue": {"friction": value}}, {("tissue", "friction"): Location("scene.yaml", 7)}))
        why = condition(form, scene, faults, Location("graph.yaml", 3), "friction")
        if text in RIGHT:
            assert not faults.entries, text
            assert (why is None) is (RIGHT[text] is not form.startswith("not")), text
        else:
            (fault,) = faults.entries
            assert "expected true or false" in fault.text and fault.place.line == 7 and fault.node == "friction", text
            assert "friction: true" in fault.cure or "friction: false" in fault.cure, text


def refuse(graph, named, path, write):
    chosen = random.Random(f"{graph} {path}").sample(WRONG, 9)
    part, _, key = path.rpartition(".")
    for text in chosen[:3]:
        with pytest.raises(GraphError, match=f"{path}: found .*expected true or false"):
            load(graph, overrides=[f"scene.{path}={text}"])
    for text in chosen[3:6]:
        scene = write("scene.yaml", f"extends: {scene_of(graph)}\n{part}: {{{key}: {text}}}\n")
        expected = f"the scene has no '{path}'" if text == "null" else f"{path}: found .*expected true or false"
        with pytest.raises(GraphError, match=expected):  # null removes the key of the extended scene
            load(graph, scene=scene)
    for text in chosen[6:]:
        scene = {**named.scene, part: {**named.scene[part], key: parse(text, "a mapping").data}}
        with pytest.raises(GraphError, match=f"{path}: found .*expected true or false"):
            load(graph, scene=scene)


@pytest.mark.parametrize("graph", NAMES)
def test_each_switch_of_each_shipped_graph_refuses_other_values(graph, write):
    """Three values from each of shell, file and mapping; 9 for each switch."""
    named = load(graph)
    for path in switches(named):
        refuse(graph, named, path, write)


def test_the_shipped_graphs_have_switches():
    found = {path for graph in ("kidney", "nodule", "softness") for path in switches(load(graph))}
    assert found >= {"tissue.friction", "energy.ledger", "finger.band", "skin.afferents"}


def test_python_refuses_them_too(tmp_path):
    with pytest.raises(PalpateError, match=r"tissue\.friction: found 'n', expected true or false"):
        palpate.run("kidney", sets={"scene.tissue.friction": "n"}, duration=0.01, record=tmp_path / "x.mcap")
    for wrong in (["n", True], [True, 0], [1.0, True], np.array([1, 0])):
        with pytest.raises(PalpateError, match=r"lane \d.*tissue.friction: found .*expected true or false"):
            palpate.Ensemble("kidney", lanes=2, over={"scene.tissue.friction": wrong}, duration=0.01)
    lanes = palpate.Ensemble("kidney", lanes=2, over={"scene.tissue.friction": np.array([True, False])}, duration=0.01)
    assert [one.job.nodes != lanes._prepared[0].job.nodes for one in lanes._prepared] == [False, True]


@pytest.mark.parametrize(
    ("when", "value", "fits"),
    [
        ("depth > 0", 3.0, True), ("depth > 0 mm", "3 mm", True), ("depth == 3", 3, True), ("depth != null", {}, True),
        ("depth == null", None, True), ("depth == soft", "soft", True), ("depth == on", False, True),
        ("depth > 0", True, False), ("depth == on", "on", False), ("depth == true", 1, False),
        ("depth > 0", "n", False), ("depth == 3", "soft", False), ("depth >= on", True, False),
        ("depth > 3 mm", "3 s", False),
    ],
)  # fmt: skip
def test_both_sides_of_a_comparison_are_of_one_kind(when, value, fits):
    faults = Faults()
    condition(when, Scene(YamlSource({"depth": value}, {})), faults, Location("graph.yaml", 3), "node")
    assert bool(faults.entries) is not fits
    assert fits or "cannot be compared" in faults.entries[0].text
