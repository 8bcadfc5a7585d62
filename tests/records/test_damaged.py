"""Recordings whose data are not what they should be: one line with the file's name, whatever is wrong in it."""

import json
from pathlib import Path

import msgspec
import pytest
from graphs_for_runs import GRAPH, write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.records.fill import begin_copy, write_json
from palpate.records.stored import Stored


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    path = folder / "run.mcap"
    assert execute(LaunchFile(graph=write_graph(folder, GRAPH), duration=0.05, record=path, place="fused")).ok
    return path


def copied(
    good: Path, target: Path, about=lambda about: about, payload=lambda name, tick, data: data, counts=None
) -> Path:
    """A sealed copy with another provenance or other bytes of a message."""
    stored = Stored(good)
    with open(target, "wb") as file:
        writer, channels = begin_copy(stored, file, about(json.loads(json.dumps(stored.about))))
        for name, tick, time, data in stored.raw():
            writer.add_message(channels[name], tick, time, payload(name, tick, data))
        write_json(writer, "palpate.counts", counts or stored.counts)
        writer.finish()
    return target


def replayed(path: Path, *more: str, command: str = "replay") -> str:
    """What a replay says of a file that it cannot read."""
    result = CliRunner().invoke(app, [command, str(path), *more], env={"COLUMNS": "400", "NO_COLOR": "1"})
    assert result.exit_code != 0 and "Traceback" not in result.output
    return result.stderr


BYTES = {
    "no msgpack": b"\xc1\xc1",
    "cut off": b"\x86\xa4tick",
    "empty": b"",
    "another type": msgspec.msgpack.encode({"tick": "x", "time": [], "source": 3, "used": {}}),
    "a list": msgspec.msgpack.encode([1, 2, 3]),
}


@pytest.mark.parametrize("how", [(), ("--check",), ("--only", "drag")])
@pytest.mark.parametrize("what", BYTES)
@pytest.mark.parametrize("stream", ["source", "drag", "sum"])
def test_invalid_message_bytes_are_an_error_with_the_file(good, tmp_path, stream, what, how):
    path = copied(good, tmp_path / "bad.mcap", payload=lambda n, k, d: BYTES[what] if (n, k) == (stream, 20) else d)
    assert str(path) in replayed(path, *how)


@pytest.mark.parametrize("what", BYTES)
def test_a_comparison_names_the_file_with_invalid_message_bytes(good, tmp_path, what):
    path = copied(good, tmp_path / "bad.mcap", payload=lambda n, k, d: BYTES[what] if (n, k) == ("drag", 20) else d)
    assert str(path) in replayed(path, "--set", "spring.every=1", command="compare")


def plans():
    """Ways in which the recorded plan may be wrong."""

    def evil_edge(plan):
        plan["nodes"][1]["name"] = "evil"

    def evil_key(plan):
        plan["edges"] = {"evil": 1}

    def list_of_nodes(plan):
        plan["nodes"] = {"evil": []}

    def order(plan):
        plan["order"] = ["evil"]

    def observers(plan):
        plan["observers"] = {"evil": ["evil"]}

    def rate(plan):
        plan["rate"] = "evil"

    def wanted(plan):
        plan["wanted"] = {"evil": 3}

    def input_(plan):
        plan["nodes"][1]["inputs"] = [{"port": "evil", "stream": "evil", "producer": "evil"}]

    def streams(plan):
        plan["nodes"][1]["streams"] = {"evil": "evil"}

    return [evil_edge, evil_key, list_of_nodes, order, observers, rate, wanted, input_, streams]


@pytest.mark.parametrize("spoil", plans(), ids=lambda spoil: spoil.__name__)
@pytest.mark.parametrize("how", [(), ("--check",), ("--set", "drag.every=2")])
def test_a_wrong_plan_is_an_error_with_the_file_or_harmless(good, tmp_path, spoil, how):
    def about(given):
        spoil(given["plan"])
        return given

    path = copied(good, tmp_path / "bad.mcap", about=about)
    result = CliRunner().invoke(app, ["replay", str(path), *how], env={"COLUMNS": "400", "NO_COLOR": "1"})
    assert "Traceback" not in result.output
    assert result.exit_code == 0 or str(path) in result.stderr, result.stderr


@pytest.mark.parametrize("counts", [{"drag": {"lost": "evil"}}, {"evil": {}}, {"drag": []}, {"drag": {"lost": -1}}])
def test_wrong_counts_are_an_error_with_the_file_or_harmless(good, tmp_path, counts):
    path = copied(good, tmp_path / "bad.mcap", counts=counts)
    result = CliRunner().invoke(app, ["replay", str(path), "--check"], env={"COLUMNS": "400", "NO_COLOR": "1"})
    assert "Traceback" not in result.output
    assert result.exit_code == 0 or str(path) in result.stderr, result.stderr
