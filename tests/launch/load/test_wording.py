"""Errors of values are in the words of a YAML file, without those of Python and its packages."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.classes import catalogue
from palpate.launch.load.graph import load
from palpate.nodes.base import SettingError, settings
from palpate.nodes.base.node import convert as take
from palpate.units.quantity import UnitError, convert

PYTHON = re.compile(
    r"\b(str|int|float|bool|dict|list\[|tuple|NoneType|None|True|False|numpy|array|object|enum|Input should|got)\b"
)
ODD = (None, True, False, 3, -3, 2.5, "soft", "", [], [1], ["a", None], {}, {"a": True}, [[1.0]], np.array([1.0, 2.0]))


def test_no_wrong_value_of_any_setting_is_described_by_python():
    """15 values for each setting of each shipped class."""
    refused = 0
    for entry in catalogue()[0]:
        for setting in settings(entry.cls).values():
            for value in ODD:
                try:
                    take(setting, value)
                except SettingError as error:
                    refused += 1
                    text = str(error).removeprefix(f"setting {setting.name!r} [{setting.unit}]: ")
                    assert text.startswith("found "), text
                    assert re.search(r"; (expected|unknown key|missing key) ", text), text
                    assert not PYTHON.search(re.sub(r"'[^']*'", "''", text)), (entry.use, text)
    assert refused > 3000


@pytest.mark.parametrize(("text", "words"), [
    ("- a\n", "found ['a'], expected a mapping of keys to values"), ("3\n", "found 3, expected a mapping"),
    ("extends: [kidney]\n", "extends: found ['kidney'], expected the name of one file"),
    ("extends: kidney\nnodes: {tissue: {stiffness: -3}}\n", "found -3; expected a number > 0"),
    ("extends: kidney\nnodes: {tissue: {second_order: 3}}\n", "found 3; expected true or false"),
    ("extends: kidney\nnodes: {tissue: {vertices: 3.5}}\n", "found 3.5; expected a whole number"),
    ("extends: kidney\nnodes: {device: {begin: [1, 2]}}\n", "found [1, 2]; expected a list of 3"),
    ("extends: kidney\nnodes: {tissue: 3}\n", "found 3, expected {use: module.Class, in: ...}"),
    ("extends: kidney\neffects: {friction: null}\n", "effects, friction: found null, expected on or off"),
])  # fmt: skip
def test_a_wrong_value_of_a_graph_is_written_as_in_its_file(text, words, write):
    with pytest.raises(GraphError) as error:
        load(write("graph.yaml", text))
    assert words in str(error.value) and not PYTHON.search(str(error.value).split("graph.yaml")[1])


def test_a_node_named_on_needs_quotes(write):
    finger = "on: {use: kinematics.FalconKinematics, in: {state: device}}"
    graph = f"extends: kidney\nnodes: {{{finger}, collision: {{in: {{pose: NAME}}}}}}\n"
    assert "on" in load(write("quoted.yaml", graph.replace("NAME", "'on'"))).nodes
    for text in (
        graph.replace("NAME", "on"),
        "extends: kidney\nwanted: [on]\n",
        "extends: kidney\nnodes: {log: {in: [no]}}\n",
    ):
        with pytest.raises(
            GraphError, match=r"YAML reads on, off, yes and no as true and false. Put a name in quotes: 'on'"
        ):
            load(write("graph.yaml", text))


@pytest.mark.parametrize(("command", "key", "other"), [("study", "vary", "over"), ("experiment", "over", "vary")])
def test_the_key_of_studies_and_that_of_experiments_are_suggested_for_each_other(command, key, other, write):
    file = write("file.yaml", f"graph: kidney\n{key}: {{tissue.stiffness: [200, 400]}}\n")
    printed = CliRunner().invoke(app, [command, str(file)])
    assert (
        printed.exit_code == 2
        and f"unknown key '{key}'" in printed.stderr
        and f"It is '{other}' here." in printed.stderr
    )


@pytest.mark.parametrize(("text", "unit", "meant"), [
    ("2 sec", "s", "s"), ("2 seconds", "s", "s"), ("3 msec", "s", "ms"), ("5 mins", "s", "min"),
    ("3 millimeters", "m", "mm"), ("45 degrees", "rad", "deg"),
    ("3 MM", "m", "mm"), ("19 kpa", "Pa", "kPa"), ("4 newtons", "N", "N"), ("1 khz", "Hz", "kHz"),
    ("3 inches", "m", "in"), ("2 Sec.", "s", ""),
])  # fmt: skip
def test_units_that_are_written_out_are_suggested(text, unit, meant):
    with pytest.raises(UnitError) as error:
        convert(text, unit)
    assert not meant or f"did you mean {meant!r}" in str(error.value)
    if meant:
        convert(f"{text.split()[0]} {meant}", unit)


def test_a_duration_in_sec_says_what_to_write():
    printed = CliRunner().invoke(app, ["run", "kidney", "--duration", "2 sec"])
    assert printed.exit_code == 2 and "did you mean 's'?" in printed.stderr


def test_numbers_of_numpy_are_taken_at_any_depth_of_a_value():
    def path(deep):
        return [{"hold": np.float64(0.1)}, {"to": np.array([0.0, 0.0, deep]), "time": np.float32(0.25)}]

    lanes = palpate.Ensemble("kidney", 2, {"device.path": [path(0.1), path(np.float64(0.099))]}, duration=0.01)
    plain = [{"hold": 0.1}, {"to": [0.0, 0.0, 0.099], "time": 0.25}]
    same = palpate.Ensemble("kidney", 1, device={"path": plain}, duration=0.01)
    assert lanes._prepared[1].job.nodes[0].settings["path"] == same._prepared[0].job.nodes[0].settings["path"]
    whole = palpate.Ensemble("kidney", 1, device={"path": path(0.1), "begin": np.array([0, 0, 0.11])}, duration=0.01)
    assert whole._prepared[0].job.nodes[0].settings["begin"] == [0.0, 0.0, 0.11]
    for tick in palpate.steps("kidney", duration=0.002):
        tick.set("device", path=path(0.1))
