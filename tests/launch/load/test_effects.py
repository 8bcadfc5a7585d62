"""Effects by name: what they switch, invalid switches, and that removing one does not change the other streams."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from short_touch import short_touch

from palpate.engine.faults import GraphError
from palpate.engine.plan import Plan
from palpate.launch.load.effects import list_effects
from palpate.launch.load.graph import load
from palpate.launch.load.plan import plan
from palpate.nodes.base import Switch, effects, part
from palpate.nodes.deformation.beam_bundle import BeamBundle
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.records.changed import change_plan


def planned(*sets, graph="kidney", **more):
    return plan(load(graph, overrides=sets, **more))


def test_a_disabled_effect_does_not_run_and_names_its_switch(write):
    run = planned("effects.friction=off")
    assert "friction" not in run.order
    assert run.skipped["friction"] == "the effect friction is off (--set effects.friction=off)"
    scene = write("scenes/wet.yaml", "extends: kidney\neffects: {friction: off}\n")
    run = planned(scene=scene)
    assert (
        run.skipped["friction"].startswith("the effect friction is off (") and "wet.yaml:2" in run.skipped["friction"]
    )


def test_an_override_precedes_the_scene_and_the_scene_precedes_the_graph(write):
    graph = write("g.yaml", "extends: kidney\nscene: s.yaml\neffects: {friction: on, band: off}\n")
    write("s.yaml", "extends: kidney\neffects: {friction: off, band: on}\n")
    run = planned(graph=graph)
    assert "friction" not in run.order and "band" in run.order
    assert "friction" in planned("effects.friction=on", graph=graph).order


def test_an_enabled_effect_runs_if_its_condition_is_false():
    assert "band" not in planned().order
    assert "band" in planned("effects.band=on").order


def test_a_part_is_computed_only_if_it_is_read_recorded_or_enabled():
    def fields(*sets, **more):
        return planned("tissue.use=deformation.BeamBundle", *sets, **more).wanted["tissue"]

    assert "displacement" in fields() and "pressure" not in fields(), "the log asks for the shape"
    assert {"pressure", "displacement", "nodes"} <= fields("effects.pressure=on")
    assert fields("effects.shape=off").isdisjoint({"displacement", "nodes"})
    assert "displacement" not in fields(wanted=["contact"])
    assert "displacement" in fields("effects.shape=on", wanted=["contact"])
    assert {"pressure", "displacement"} <= fields("log.fields=all")


def test_a_disabled_effect_of_a_setting_sets_its_neutral_value():
    run = planned("effects.relaxation=off")
    assert run.graph.nodes["tissue"].settings["damping"] == 0.0
    run = planned("tissue.use=deformation.BeamBundle", "effects.relaxation=off")
    assert run.graph.nodes["tissue"].settings["relaxations"] == [0.0, 0.0]
    nodule = planned("effects.nodule=off", graph="nodule").graph.nodes["tissue"].settings
    assert (
        nodule["nodule_radius"] == 0.0 and planned(graph="nodule").graph.nodes["tissue"].settings["nodule_radius"] > 0
    )


@pytest.mark.parametrize(
    ("override", "fault_text"),
    [
        ("effects.frction=off", ["there is no effect 'frction'", "Did you mean 'friction'?"]),
        ("effects.pressure=on", ["no node of this graph computes 'pressure'", "deformation.BeamBundle"]),
        ("effects.nodule=on", ["nodule is on, but tissue.nodule_radius is at the value without it"]),
        ("effects.friction=maybe", ["found 'maybe', expected on or off"]),
        ("effects=5", ["effects"]),
    ],
)
def test_an_invalid_switch_is_an_error_with_a_remedy(override, fault_text):
    with pytest.raises(GraphError) as error:
        load("kidney", overrides=[override])
    for text in (*fault_text, override.partition("=")[0].partition(".")[0]):
        assert text in str(error.value)


def test_a_custom_body_is_assumed_to_fill_its_message():
    assert "tissue" in planned("tissue.use=deformation.Rigid", "effects.shape=on").order


def test_a_plan_keeps_the_switches():
    run = planned("effects.friction=off", "effects.shape=on")
    again = Plan.from_spec(json.loads(json.dumps(run.to_spec())))
    assert {n: c.on for n, c in again.graph.effects.items()} == {"friction": False, "shape": True}
    assert again.wanted == run.wanted and again.skipped == run.skipped


def test_each_declared_effect_names_fields_and_settings_that_exist():
    from palpate.launch.load.classes import catalogue
    from palpate.nodes.base import outputs
    from palpate.nodes.base import settings as settings_of

    for entry in catalogue()[0]:
        for effect in effects(entry.cls):
            if effect.how == "part":
                sent = {f for kind in outputs(entry.cls) for f in kind.__struct_fields__}
                assert set(effect.fields) <= sent, entry.use
            assert not effect.setting or effect.setting in settings_of(entry.cls)
    assert {"friction", "deformation", "shape", "pressure", "nodule", "relaxation", "band"} <= set(list_effects())


def test_a_switch_shows_whether_the_effect_is_computed():
    mark = Switch("relaxation")
    assert mark.has((0.1, 0.0)) and mark.has([2.0]) and not mark.has((0.0, 0.0)) and not mark.has(0.0)
    assert mark.without((0.1, 4.0)) == [0.0, 0.0] and mark.without(3.0) == 0.0


def test_a_part_that_no_node_reads_is_not_computed():
    class Counting:
        wanted = None
        calls = 0

        @part("pressure", "pressure", otherwise=-1)
        def pressure(self):
            """Counts."""
            self.calls += 1
            return self.calls

    node = Counting()
    assert node.pressure() == 1
    node.wanted = frozenset({"force"})
    assert node.pressure() == -1 and node.calls == 1
    node.wanted = frozenset({"pressure"})
    assert node.pressure() == 2


BODIES = {"MassSpring": MassSpring, "BeamBundle": BeamBundle}


def rendered(recording):
    """The messages of the controller without their `used`, which changes if the ledger is off."""
    return [(m.tick, m.time, m.force, m.state, m.energy) for m in recording.messages("controller")]


@pytest.mark.parametrize("body", BODIES)
def test_wanted_streams_are_the_same_without_unread_parts(tmp_path_factory, body):
    """Random subsets of the parts give bit-equal forces and never compute more parts than the whole set."""
    folder = tmp_path_factory.mktemp("parts")
    swap = f"tissue.use=deformation.{body}"
    parts = sorted({e.name for e in effects(BODIES[body]) if e.how == "part"})
    whole = short_touch(folder, "whole", swap, "log.fields=all", *(f"effects.{p}=on" for p in parts), "effects.band=on")
    forces = rendered(whole)
    assert np.abs(whole.columns("contact")["force"]).max() > 0.01, "the run has no touch"

    @settings(max_examples=4)
    @given(st.sets(st.sampled_from([*parts, "band", "sample"])))
    def check(off):
        less = short_touch(
            folder, "less", swap, "effects.band=on", *(f"effects.{p}=off" for p in off), wanted=("controller",)
        )
        assert rendered(less) == forces

    check()


def test_a_replay_keeps_the_recorded_fields_except_those_of_disabled_effects(tmp_path):
    recording = short_touch(tmp_path, "one", "log.fields=all")
    assert "displacement" in change_plan(recording, ["tissue.damping=1"]).wanted["tissue"]
    assert "displacement" not in change_plan(recording, ["effects.shape=off"]).wanted["tissue"]


def test_the_documented_catalogue_is_up_to_date():
    from typer.testing import CliRunner

    from palpate.cli.__main__ import app

    rows = json.loads(CliRunner().invoke(app, ["list", "effects", "--json"]).stdout)["effects"]
    assert len(rows) > 10 and {"effect", "computed_by", "shown_by", "about"} <= set(rows[0])
    lines = ["| effect | what computes it | fields that show it |", "|---|---|---|"]
    for row in rows:
        by, fields = ([f"`{one}`" for one in row[key]] for key in ("computed_by", "shown_by"))
        lines.append(f"| `{row['effect']}` | {'; '.join(by)} | {', '.join(fields) or 'all it sends'} |")
    shown = "\n".join(lines) + "\n"
    assert shown in (Path(__file__).parents[3] / "docs" / "effects.md").read_text(encoding="utf-8"), shown
