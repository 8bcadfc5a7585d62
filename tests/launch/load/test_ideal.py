"""Ideal hands: `hand: {ideal: true}` in a scene (launch/load/checks/ideal.py)."""

import pytest

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.checks.ideal import OPTION, describe_jumps, imperfections, jumps
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load

IDEAL = OPTION.removeprefix("--set ")
SHIPPED = sorted(path.stem for path in GRAPHS.glob("*.yaml"))
HARDWARE = {"cartesian", "falcon", "falcons", "indentation"}
RESOLUTIONS = {"device.resolution", "finger.resolution", "controller.resolution"}


@pytest.mark.parametrize("name", SHIPPED)
def test_every_scene_takes_the_switch(name):
    if name in HARDWARE:
        with pytest.raises(GraphError, match="is hardware, whose encoder has counts"):
            load(name, overrides=[IDEAL])
        return
    usual, ideal = load(name), load(name, overrides=[IDEAL])
    assert not list(imperfections(ideal.nodes.values()))
    found = {each.path for each in imperfections(usual.nodes.values())}
    for node, spec in usual.nodes.items():  # nothing else changes
        other = ideal.nodes[node].settings
        changed = {f"{node}.{key}" for key, value in spec.settings.items() if other[key] != value}
        assert changed == {path for path in found if path.startswith(f"{node}.")}


def test_a_scene_without_the_switch_keeps_its_settings():
    assert load("kidney", overrides=[f"{IDEAL[:-4]}false"]).nodes == load("kidney").nodes


def test_an_override_of_the_setting_itself_is_kept():
    mixed = load("kidney", overrides=[IDEAL, "device.resolution=1e-4", "scene.sliding.play=1e-5"])
    assert mixed.nodes["device"].settings["resolution"] == 1e-4
    assert mixed.nodes["friction"].settings["play"] == 1e-5
    assert [each.path for each in jumps(mixed.nodes.values())] == ["device.resolution"]
    assert describe_jumps(mixed, mixed.nodes).endswith("smooth with --set device.resolution=0")


def test_the_usual_kidney_names_what_jumps_and_the_switch():
    usual = load("kidney")
    assert {each.path for each in jumps(usual.nodes.values())} == RESOLUTIONS
    assert describe_jumps(usual, usual.nodes).endswith(f"smooth with {OPTION}")


def test_the_steps_of_a_pin_are_not_those_of_the_hand():
    rough = load("softness", overrides=[IDEAL, "scene.pins.resolution=1 um"])
    assert describe_jumps(rough, rough.nodes).endswith("smooth with --set display.resolution=0")


def test_another_value_is_refused():
    with pytest.raises(GraphError, match=r"hand\.ideal: found 3, expected true or false"):
        load("kidney", overrides=["scene.hand.ideal=3"])


def test_a_written_scene_with_the_switch(tmp_path):
    scene = tmp_path / "ideal.yaml"
    scene.write_text("extends: kidney\nhand: {ideal: true}\n")
    assert not jumps(load("kidney", scene=scene).nodes.values())


def test_the_ideal_force_is_near_the_usual_one():
    forces = [
        palpate.Ensemble("kidney", 1, sets=sets, duration=1.2).run(quiet=True)["contact.force"].values
        for sets in ([], [IDEAL])
    ]
    assert abs(forces[1] - forces[0]).max() < 0.02 * forces[0].max()  # [N]
