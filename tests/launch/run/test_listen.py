"""Reading the streams of a running graph: the example of the documentation, `palpate echo` and `palpate top`."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
import zmq
from graphs_for_runs import GRAPH, NODES, write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.commands.running import top
from palpate.launch.run.wire import discover
from palpate.launch.run.wire.addresses import endpoint
from palpate.launch.run.wire.bus import HEALTH
from palpate.launch.run.wire.discover import find, running
from palpate.messages import Health, pack

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
ENV = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2] / "support"), os.environ.get("PYTHONPATH", "")]),
}
RATE = 250  # [Hz]
RUN = """
import sys
from pathlib import Path
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
print(execute(LaunchFile(graph=Path(sys.argv[1]), clock="real")).result.deaths or "", end="", file=sys.stderr)
"""


def say(*args):
    result = CliRunner().invoke(app, [str(a) for a in args], env={"COLUMNS": "200", "NO_COLOR": "1"})
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A graph that runs until the end of the tests; yields the name of its run."""
    graph = write_graph(tmp_path_factory.mktemp("run"), f"rate: {RATE}\n{GRAPH}")
    with subprocess.Popen([sys.executable, "-c", RUN, str(graph)], env=ENV) as process:
        until = time.monotonic() + 120
        while time.monotonic() < until:
            own_runs = [r for r in running() if r.name.startswith(f"{process.pid}-")]
            if own_runs and len(own_runs[0].groups) == len(NODES):
                break
            time.sleep(0.05)
        yield own_runs[0].name
        process.send_signal(2)
        process.wait(120)


def test_the_example_reads_a_stream_with_pyzmq_and_msgpack_alone(run):
    pytest.importorskip("msgpack")
    text = (EXAMPLES / "listen.py").read_text()
    assert "palpate." not in re.sub(r"palpate-|palpate run", "", text), "the example must not need palpate"
    command = [sys.executable, EXAMPLES / "listen.py", "spread", "5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 5 and all(line.startswith("spread {") for line in lines)
    ticks = [int(re.search(r"'tick': (\d+)", line)[1]) for line in lines]
    assert ticks == sorted(ticks) and "'forces': (" in lines[0]


def test_the_example_in_c_reads_a_stream(run, tmp_path):
    """It is linked with the library of pyzmq, and compiled with the system's header if it exists."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: apt install gcc")
    brought = sorted(Path(zmq.__file__).parents[1].glob("pyzmq.libs/libzmq*"))
    library = [brought[0], f"-Wl,-rpath,{brought[0].parent}"] if brought else ["-lzmq"]
    header = Path(__file__).parents[2] / "support" / "zmq_header"
    source = [EXAMPLES / "listen.c", "-idirafter", header, "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *source, "-o", tmp_path / "listen", *library], check=True)
    address = endpoint(run, "sum", "observers")
    done = subprocess.run([tmp_path / "listen", address, "sum", "5"], capture_output=True, text=True, timeout=120)
    matches = [re.fullmatch(r"sum tick (\d+) time ([\d.]+) s, \d+ bytes", line) for line in done.stdout.splitlines()]
    assert len(matches) == 5
    for match in matches:
        assert abs(float(match[2]) - int(match[1]) / RATE) < 0.1


def test_echo_prints_values_with_units(run):
    code, out, err = say("echo", "sum", "-n", "3", "--run", run)
    assert code == 0, err
    assert len(out.splitlines()) == 3 and "torques (" in out and "N m" in out
    code, out, _ = say("echo", "spread", "-n", "2", "--every", "3", "--json", "--run", run)
    first, second = map(json.loads, out.splitlines())
    assert second["tick"] >= first["tick"] + 3 and len(first["forces"]) == 50


def test_echo_of_an_unknown_stream_is_an_error(run):
    code, _, err = say("echo", "sprong", "--run", run)
    assert code == 1 and "no stream 'sprong'" in err and "Did you mean 'spring'" in err


def test_top_shows_rates_and_counts_of_every_node(run):
    code, out, err = say("top", "--json", "--run", run)
    assert code == 0, err
    data = json.loads(out)
    assert data["run"] == run and set(data["nodes"]) == set(NODES)
    for node in data["nodes"].values():
        assert node["steps"] > 0 and node["median"] > 0 and node["p99"] >= node["median"] and node["late"] >= 0
    assert any(node["rate"] > 0 for node in data["nodes"].values())
    code, out, _ = say("top", "--once", "--run", run)
    assert code == 0 and "longest" in out and "spread" in out, out


def test_top_collects_for_a_second_without_stalls(monkeypatch):
    """After stalls before the first report and after the second, all nodes still have their rates."""
    clock = [0.0]

    def reports(*_):
        for turn in range(20):
            clock[0] += 3.0 if turn in (0, 2) else 0.2
            for name in ("a", "b"):
                printed = Health.example(loaded=False)
                yield HEALTH, pack(msgspec.structs.replace(printed, source=name, steps=100 * turn))

    monkeypatch.setattr(discover, "receive_messages", reports)
    monkeypatch.setattr(discover, "find", lambda _: discover.Running("1-a"))
    monkeypatch.setattr(top.time, "monotonic", lambda: clock[0])
    code, out, err = say("top", "--json")
    assert code == 0, err
    rates = {name: node["rate"] for name, node in json.loads(out)["nodes"].items()}
    assert set(rates) == {"a", "b"} and min(rates.values()) > 0.0
    assert clock[0] < 8.0  # a second of reports, and the stalls


def test_a_run_that_is_not_active_is_an_error():
    for args in (["top", "--run", "no-such"], ["echo", "sum", "--run", "no-such"]):
        code, _, err = say(*args)
        assert code == 1 and "run 'no-such' is not active" in err and len(err.strip().splitlines()) == 1


def test_a_run_is_found_by_the_beginning_of_its_name(run):
    assert find(run[:-3]).name == run
