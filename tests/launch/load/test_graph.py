"""Loading graphs: contents, and faults with cause and remedy."""

import re
import sys

import pytest

from palpate.engine.faults import GraphError
from palpate.engine.graph import Edge
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find


def held(graph):
    return {(name, e.port) for name, node in graph.nodes.items() for e in node.edges if e.loop}


def test_a_whole_graph_is_read(whole):
    graph = load(whole)
    assert graph.rate == 1000.0
    assert next(iter(graph.nodes)) == "device" and len(graph.nodes) == 10
    assert graph.nodes["contact"].edges == (
        Edge("proximity", "near", "near", False),
        Edge("body", "tissue", "tissue", True),
    )
    assert graph.nodes["friction"].when == "tissue.friction"
    assert graph.nodes["log"].listen is None and graph.nodes["log"].edges == ()


def test_only_loop_edges_are_held(whole):
    assert held(load(whole)) == {("device", "torque"), ("contact", "body")}


def test_settings_come_from_class_scene_line_and_command_line_in_that_order(whole):
    spring = load(whole).nodes["tissue"].settings
    assert spring == {"stiffness": 400.0, "exponent": 1.0}
    finger = load(whole).nodes["finger"].settings
    assert finger == {"radius": 0.006, "h0": 0.003}
    text = whole.read_text().replace("with: $tissue", "with: $tissue, stiffness: 7")
    whole.write_text(text)
    assert load(whole).nodes["tissue"].settings["stiffness"] == 7.0
    assert load(whole, overrides=["tissue.stiffness=8 N/m"]).nodes["tissue"].settings["stiffness"] == 8.0
    both = load(whole, overrides=["tissue.stiffness=8", "tissue.stiffness=2e3"])
    assert both.nodes["tissue"].settings["stiffness"] == 2000.0


def test_a_later_with_precedes_an_earlier_one(whole):
    text = whole.read_text().replace("with: $tissue", "with: [$tissue, {stiffness: 9 N/m}]")
    whole.write_text(text)
    assert load(whole).nodes["tissue"].settings["stiffness"] == 9.0


def test_a_mapping_may_have_settings_of_any_class_of_the_module_but_no_others(whole):
    """So that one word swaps the models of a custom module. `Moody` has `high`, and no shipped class has."""
    text = whole.read_text()
    whole.write_text(text.replace("with: $tissue", "with: [$tissue, {high: 2 m}]"))
    assert load(whole).nodes["tissue"].settings["stiffness"] == 400.0
    whole.write_text(text.replace("with: $tissue", "with: [$tissue, {highest: 2 m}]"))
    with pytest.raises(GraphError, match="'highest' is a setting of no class of graph_nodes"):
        load(whole)


def test_one_word_swaps_the_model(whole):
    foam = load(whole, overrides=["tissue.use=graph_nodes.Foam"])
    assert foam.nodes["tissue"].settings == {"stiffness": 400.0, "cells": 12}
    plain = load(whole)
    assert {n: s.edges for n, s in foam.nodes.items()} == {n: s.edges for n, s in plain.nodes.items()}


def test_a_custom_class_takes_its_settings_from_the_scene(whole, write, monkeypatch):
    write(
        "mylab.py",
        """
        from typing import Annotated
        from palpate.messages import Load, Surface
        from palpate.nodes import Node

        class Liver(Node):
            stiffness: Annotated[float, "N/m"] = 1.0

            def step(self, load: Load) -> Surface:
                return Surface([], [], self.stiffness, 1.0, 0.0, 0.0, 0.0)
    """,
    )
    monkeypatch.chdir(whole.parent)
    monkeypatch.setattr(sys, "path", [*sys.path])
    whole.write_text(whole.read_text().replace(", cells: 12", ""))
    assert load(whole, overrides=["tissue.use=mylab.Liver"]).nodes["tissue"].settings == {"stiffness": 400.0}


def test_an_unused_effect_is_valid_and_a_typing_error_is_a_fault(whole):
    text = (
        whole.read_text().replace(", when: tissue.friction", "").replace("friction: true", "friction: true, FLAG: on")
    )
    whole.write_text(text.replace("FLAG: on", "radios: on"))
    with pytest.raises(GraphError, match=r"tissue\.radios.*\n.*Did you mean 'radius'"):
        load(whole)
    whole.write_text(text.replace("FLAG: on", "adhesion: on"))
    load(whole)


def test_a_dollar_reads_the_scene_anywhere_in_a_value(whole):
    text = whole.read_text().replace("in: {pose: finger}}", "in: {pose: finger}, offset: [$finger.h0, 1 mm, 0]}")
    whole.write_text(text)
    assert load(whole).nodes["near"].settings["offset"] == [0.003, 0.001, 0.0]
    changed = load(whole, overrides=["scene.finger.h0=5 mm"])
    assert changed.nodes["near"].settings["offset"] == [0.005, 0.001, 0.0]
    assert changed.nodes["finger"].settings["h0"] == 0.005


def test_a_scene_may_refer_to_itself(whole):
    whole.write_text(whole.read_text().replace("h0: 3e-3", "h0: $finger.radius"))
    assert load(whole).nodes["finger"].settings["h0"] == 0.006


def test_a_whole_number_may_be_written_with_an_exponent(whole):
    assert load(whole, overrides=["near.count=2e3"]).nodes["near"].settings["count"] == 2000
    with pytest.raises(GraphError, match=r"setting 'count' \[1\]: found 2.5"):
        load(whole, overrides=["near.count=2.5"])


def test_another_scene_replaces_that_of_the_graph(whole, write):
    scene = write("dry.yaml", "tissue: {friction: false, stiffness: 5}\nfinger: {}\n")
    for chosen in (scene, str(scene), {"tissue": {"friction": False, "stiffness": 5}, "finger": {}}):
        graph = load(whole, scene=chosen)
        assert graph.nodes["tissue"].settings["stiffness"] == 5.0
        assert "tissue.friction is false" in graph.nodes["friction"].off


def test_a_scene_file_is_found_next_to_the_graph_and_may_extend_another(whole, write):
    write("scenes/base.yaml", "tissue: {friction: true, stiffness: 3}\nfinger: {radius: 1 mm}\n")
    write("scenes/soft.yaml", "extends: base.yaml\ntissue: {stiffness: 2, friction: null}\n")
    body = whole.read_text().split("nodes:")[1].replace(", when: tissue.friction", "")
    whole.write_text("scene: scenes/soft.yaml\nnodes:" + body)
    graph = load(whole)
    assert graph.scene == {"tissue": {"stiffness": 2}, "finger": {"radius": "1 mm"}}


def test_a_scene_written_in_a_graph_a_launch_file_or_python_extends_a_file(whole, write):
    write("scenes/soft.yaml", "extends: base.yaml\ntissue: {stiffness: 2}\n")
    write("scenes/base.yaml", "tissue: {friction: true, stiffness: 1}\nfinger: {radius: 4 mm}\n")
    inline = "scene: {extends: scenes/soft.yaml, finger: {h0: 1 mm}}\n"
    expected = {"tissue": {"friction": True, "stiffness": 2}, "finger": {"radius": "4 mm", "h0": "1 mm"}}
    child = write("child.yaml", f"extends: whole.yaml\n{inline}")
    launch = find(str(write("launch.yaml", f"graph: whole.yaml\n{inline}")))
    given = {"extends": str(whole.parent / "scenes" / "soft.yaml"), "finger": {"h0": "1 mm"}}
    for graph in (load(child), launch.load(), load(whole, scene=given)):
        assert graph.scene == expected
    assert given["extends"]  # the caller's mapping stays
    for scene, message in (({"extends": "kidny"}, "'kidny' not found"), ({"extends": 3}, "extends: found 3")):
        with pytest.raises(GraphError, match=message):
            load(whole, scene=scene)


def test_a_graph_extends_another_node_by_node(whole, write):
    child = write(
        "child.yaml",
        """
        extends: whole.yaml
        rate: 0.5 kHz
        scene: {finger: {radius: 9 mm}}
        nodes:
          tissue: {use: graph_nodes.Foam, cells: 3}
          friction: null
          spread: {in: {friction: null}}
          control: {in: {friction: null}, every: 2}
          lamp: {use: graph_nodes.Near, in: {pose: finger}}
    """,
    )
    graph = load(child)
    assert graph.rate == 500.0
    assert "friction" not in graph.nodes and list(graph.nodes)[-1] == "lamp"
    assert graph.nodes["tissue"].settings == {"stiffness": 400.0, "cells": 3}
    assert graph.nodes["finger"].settings == {"radius": 0.009, "h0": 0.003}
    assert graph.nodes["control"].every == 2 and len(graph.nodes["control"].edges) == 1


def test_another_class_replaces_the_inputs_only_if_it_has_inputs(whole, write):
    """With the same class the inputs are merged with those of the parent."""
    text = "extends: whole.yaml\nnodes: {{{}}}\n"
    new = "spread: {use: graph_nodes.Rub, in: {contact: contact}}, tissue: null, contact: {in: {body: null}}"
    replaced = load(write("a.yaml", text.format(new)))
    assert [e.port for e in replaced.nodes["spread"].edges] == ["contact"]
    kept = load(write("b.yaml", text.format("tissue: {use: graph_nodes.Foam}")))
    assert [e.port for e in kept.nodes["tissue"].edges] == ["load"]
    laid = load(write("c.yaml", text.format("spread: {in: {friction: null}}")))
    assert [e.port for e in laid.nodes["spread"].edges] == ["contact"]


def test_an_override_removes_an_input_of_any_class(whole):
    taken = load(
        whole,
        overrides=["spread.in.friction=null", "spread.use=graph_nodes.StrictSpread", "spread.in.friction=friction"],
    )
    assert [e.port for e in taken.nodes["spread"].edges] == ["contact", "friction"]
    alone = load(
        whole, overrides=["contact.use=sensor.ForceSensor", "contact.in.body=null", "contact.in.proximity=null"]
    )
    assert alone.nodes["contact"].edges == ()
    with pytest.raises(GraphError, match="input 'bodi': unknown"):
        load(whole, overrides=["contact.in.bodi=null"])


def test_a_fault_of_a_replaced_class_names_the_place_of_the_replacement(whole, write):
    changed = write("changed.yaml", "extends: whole.yaml\nnodes:\n  near: {use: graph_nodes.Rub}\n")
    with pytest.raises(GraphError) as error:
        load(changed)
    printed = str(error.value)
    assert (
        "changed.yaml:3: node 'near', input 'pose': unknown; it belongs to the previous class of this node" in printed
    )
    assert "whole.yaml:8)" in printed and "To remove it: `in: {pose: null}`." in printed
    assert "changed.yaml:3: node 'near', input 'contact': input, which drives the node, has no sender" in printed
    whole.write_text(whole.read_text().replace("in: {pose: finger}}", "in: {pose: finger}, count: 2}"))
    with pytest.raises(GraphError, match=r"changed\.yaml:3: node 'near', setting 'count': unknown; .*whole\.yaml:8\)"):
        load(changed)
    with pytest.raises(GraphError, match=r"--set near\.use=graph_nodes\.Rub: node 'near', setting 'count': unknown"):
        load(whole, overrides=["near.use=graph_nodes.Rub"])


def test_an_override_removes_a_node(whole):
    graph = load(whole, overrides=["log=null"])
    assert "log" not in graph.nodes


def test_several_outputs_are_named_by_their_message(write):
    graph = load(
        write(
            "g.yaml",
            """
        nodes:
          device: {use: graph_nodes.Hand, in: {torque: both}}
          finger: {use: graph_nodes.Finger, in: {state: device}}
          both: {use: graph_nodes.Both, in: {pose: finger}}
          motor: {use: graph_nodes.Motor, in: {force: both.Force}}
          log: {use: graph_nodes.Tape, in: [both.Torque, finger]}
    """,
        )
    )
    assert graph.nodes["device"].edges == (Edge("torque", "both", "both.Torque", True),)
    assert graph.nodes["motor"].edges == (Edge("force", "both", "both.Force", False),)
    assert list(graph.nodes["both"].streams) == ["both.Force", "both.Torque"]
    assert graph.nodes["log"].listen == ("both.Torque", "finger")


def test_the_file_may_name_the_loop_edge(write):
    text = """
        nodes:
          device: {use: graph_nodes.Hand}
          finger: {use: graph_nodes.Finger, in: {state: device}}
          near: {use: graph_nodes.Near, in: {pose: finger}}
          contact: {use: graph_nodes.Press, in: {proximity: near}}
          friction: {use: graph_nodes.Rub, in: {contact: contact}}
          control: {use: graph_nodes.Control, in: {contact: contact, friction: %s}}
    """
    assert held(load(write("a.yaml", text % "friction"))) == set()
    assert held(load(write("b.yaml", text % "{from: friction, loop: true}"))) == {("control", "friction")}


def test_of_two_optional_edges_of_a_loop_the_backward_one_is_held(write):
    """Each node reads the other; only the order in the file decides which comes first."""
    nodes = {
        "spread": "{use: graph_nodes.Spread, in: {contact: contact, friction: friction}}",
        "tissue": "{use: graph_nodes.Spring, in: {load: spread}}",
        "press": "{use: graph_nodes.Press, in: {proximity: near, body: tissue}}",
        "friction": "{use: graph_nodes.Rub, in: {contact: press}}",
    }
    head = """nodes:
  device: {use: graph_nodes.Hand}
  finger: {use: graph_nodes.Finger, in: {state: device}}
  near: {use: graph_nodes.Near, in: {pose: finger}}
  contact: {use: sensor.ForceSensor}
"""
    order = ["spread", "tissue", "press", "friction"]
    lines = head + "".join(f"  {name}: {nodes[name]}\n" for name in order)
    assert held(load(write("a.yaml", lines))) == {("spread", "friction")}
    order = ["press", "friction", "spread", "tissue"]
    lines = head + "".join(f"  {name}: {nodes[name]}\n" for name in order)
    assert held(load(write("b.yaml", lines))) == {("press", "body")}


def test_all_faults_are_reported_at_once(whole, write):
    bad = write(
        "bad.yaml",
        """
        extends: whole.yaml
        rates: 3
        nodes:
          near: {count: many}
          contact: {stifness: 3, in: {body: finger}}
          tissue: {use: graph_nodes.Sprung, every: 0}
          friction: {when: tissue.frictn}
          motor: {in: {force: contrl, foo: x}}
    """,
    )
    with pytest.raises(GraphError) as error:
        load(bad, overrides=["scene.fingr=1", "tisue.x=1", "foo"])
    printed = str(error.value)
    for word in (
        "rates",
        "many",
        "stifness",
        "'body'",
        "Sprung",
        "every: found 0",
        "frictn",
        "contrl",
        "'foo'",
        "fingr",
        "tisue",
        "--set foo",
    ):
        assert word in printed
    assert len(error.value.faults) == 12
    assert len(re.findall(r"bad.yaml:\d+", printed)) == 9


def test_a_required_input_whose_sender_is_off_is_a_fault(whole):
    text = whole.read_text().replace("graph_nodes.Spread", "graph_nodes.StrictSpread")
    whole.write_text(text)
    load(whole)
    with pytest.raises(GraphError) as error:
        load(whole, overrides=["scene.tissue.friction=false"])
    printed = str(error.value)
    assert "node 'spread', input 'friction': is not optional, but its sender 'friction' does not run" in printed
    assert "tissue.friction is false" in printed and "`friction: Friction | None`" in printed


def test_a_driving_input_whose_sender_is_off_is_a_fault(whole):
    whole.write_text(whole.read_text() + "  lamp: {use: graph_nodes.Lamp, in: {friction: friction}}\n")
    with pytest.raises(GraphError, match="drives this node, but its sender 'friction' does not run"):
        load(whole, overrides=["scene.tissue.friction=false"])
    load(whole, overrides=["scene.tissue.friction=false", "lamp.when=tissue.friction"])


@pytest.mark.parametrize(
    ("when", "runs"),
    [
        ("tissue.friction", True),
        ("$tissue.friction", True),
        ("not tissue.friction", False),
        ("tissue.stiffness > 0", True),
        ("tissue.stiffness > 399", True),
        ("tissue.stiffness > 0.4 kN/m", False),
        ("tissue.stiffness >= 0.4 kN/m", True),
        ("tissue.stiffness < 0.5 N/mm", True),
        ("tissue.cells == 12", True),
        ("tissue.cells != 12", False),
        ("tissue.cells <= 11", False),
        ("finger.radius > 5 mm", True),
        ("true", True),
        ("false", False),
    ],
)
def test_conditions_decide_whether_a_node_runs(whole, when, runs):
    graph = load(whole, overrides=[f"friction.when={when}"])
    assert (graph.nodes["friction"].off is None) == runs


def test_a_missing_package_is_an_error_with_its_extra(whole, write, monkeypatch):
    write("needs.py", "import skfem_that_is_missing\n")
    write("needs_scan.py", "raise ModuleNotFoundError(\"No module named 'pydicom'\", name='pydicom')\n")
    write("broken.py", "1/0\n")
    write("wrong.py", "def f(:\n")
    monkeypatch.chdir(whole.parent)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for use, words in {
        "needs.Node": ["cannot be imported", "skfem_that_is_missing"],
        "needs_scan.Node": ["the package pydicom is not installed", 'pip install "palpate[scan]"'],
        "broken.Node": ["importing 'broken' failed", "ZeroDivisionError", "broken.py:1"],
        "wrong.Node": ["SyntaxError", "wrong.py:1"],
    }.items():
        with pytest.raises(GraphError) as error:
            load(whole, overrides=[f"tissue.use={use}"])
        for word in words:
            assert word in str(error.value)


def test_a_folder_instead_of_a_file_is_an_error(tmp_path):
    with pytest.raises(GraphError, match=f"{tmp_path.name}' is a folder"):
        load(str(tmp_path))
