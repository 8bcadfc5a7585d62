"""The work of checking a graph grows in proportion to its nodes."""

import json
import sys

import pytest
import yaml
from graphs_for_runs import GRAPH, write_graph

from palpate.launch.load.files import GRAPHS
from palpate.launch.load.launchfile import LaunchFile

LOG = "  log:    {use: logger.Mcap, in: all}\n"


def parallel(count: int) -> str:
    """Nodes that no node reads: without the logger they are skipped."""
    return GRAPH.replace(LOG, "") + "".join(
        f"  s{i}: {{use: nodes_for_runs.Spring, in: {{pose: source}}}}\n" for i in range(count)
    )


def chain(count: int) -> str:
    """Carriers, each of which forwards the messages of the next line."""
    lines = [
        f"  d{i}: {{use: transport.Delay, in: {{message: {f'd{i - 1}' if i else 'source'}}}}}" for i in range(count)
    ]
    return GRAPH + "\n".join(lines[::-1]) + "\n"


def fingers(count: int) -> str:
    """The kidney several times."""
    lines = ["scene: kidney", "nodes:"]
    for number in range(count // 10):
        for name, line in yaml.safe_load((GRAPHS / "kidney.yaml").read_text())["nodes"].items():
            if isinstance(line["in"], dict):
                line["in"] = {port: f"{sender}_{number}" for port, sender in line["in"].items()}
                lines.append(f"  {name}_{number}: {json.dumps(line)}")
    return "\n".join(lines) + "\n"


def opcodes(launch: LaunchFile) -> int:
    """Number of executed instructions of the interpreter: a measure of work without a clock."""
    count = 0

    def trace(frame, event, argument):
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        launch.plan()
    finally:
        sys.settrace(before)
    return count


@pytest.mark.parametrize("shape", [parallel, chain, fingers])
def test_the_work_of_a_check_is_proportional_to_the_number_of_nodes(tmp_path, shape):
    opcodes(LaunchFile(write_graph(tmp_path, shape(20))))  # fills the caches
    first, second, third = (opcodes(LaunchFile(write_graph(tmp_path, shape(n)))) for n in (20, 60, 100))
    assert third - second < 1.2 * (second - first)  # equal if linear, 2 times if quadratic


def test_a_long_chain_of_carriers_is_checked(tmp_path):
    """Longer than the interpreter's limit of nested calls."""
    assert len(LaunchFile(write_graph(tmp_path, chain(1500))).plan().order) == 1505
