"""Any failure of a node: the device loses its torque, the failed node is named, no process survives the run, and the
recording before the failure can be checked."""

from pathlib import Path

import pytest
from graphs_for_runs import GRAPH, write_graph

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import RunOutcome, execute
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify

KILLED = {
    "kill": "killed by SIGKILL",
    "terminate": "killed by SIGTERM",
    "kill group": "killed by SIGKILL",
}


def _long(*given: str):
    return pytest.param(*given, marks=pytest.mark.long)


def go(folder: Path, how: str, clock: str, patience: float = 1.0, **more) -> RunOutcome:
    text = GRAPH.replace(
        "nodes_for_runs.Spring,", f'nodes_for_runs.Faulty, how: "{how}", at: 300, note: {folder}/fault,'
    )
    launch = LaunchFile(graph=write_graph(folder, text), duration=10.0, clock=clock, record=folder / "run.mcap", **more)
    return execute(launch, patience=patience)


def check(folder: Path) -> None:
    recording = Recording(folder / "run.mcap")
    report = verify(recording, plan_of(recording))
    assert report.ok, report.first


@pytest.mark.parametrize("how", ["stop", "spin", "print", "eat", "kill", _long("hang")])
def test_the_device_is_without_torque_20_ms_after_a_fault_of_any_kind(tmp_path, how):
    outcome = go(tmp_path, how, "real")
    (death,) = outcome.result.deaths
    assert death.node == "spring"
    fault = int((tmp_path / "fault").read_text())
    samples = list(Recording(tmp_path / "run.mcap").messages("source"))
    after = [m.used == (-1,) for m in samples if m.tick > fault]  # whether it has no torque
    without = after.index(True)
    assert without <= 20  # samples: a busy machine may delay the device
    assert all(after[without + 20 :])
    check(tmp_path)


@pytest.mark.parametrize(
    ("clock", "how"),
    [
        ("real", "kill group"),
        ("simulated", "kill"),
        *(_long("real", how) for how in ("kill", "terminate")),
        *(_long("simulated", how) for how in ("terminate", "kill group")),
    ],
)
def test_a_node_that_kills_its_process_or_group_is_named(tmp_path, clock, how):
    outcome = go(tmp_path, how, clock)
    (death,) = outcome.result.deaths
    assert death.node == "spring" and KILLED[how] in death.text
    check(tmp_path)


@pytest.mark.parametrize(("how", "text"), [("stop", "a signal has stopped its process"), _long("spin", "it hangs")])
def test_on_the_simulated_clock_a_hung_node_is_named_and_the_recording_is_valid(tmp_path, how, text):
    outcome = go(tmp_path, how, "simulated")
    (death,) = outcome.result.deaths
    assert death.node == "spring" and text in death.text
    check(tmp_path)


def test_a_node_continues_after_the_death_of_its_optional_driving_sender(tmp_path):
    """Its recording can be checked."""
    text = """
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Faulty, in: {pose: source}, how: kill, at: 300}
  follow: {use: nodes_for_runs.Follow, in: {force: spring}}
  log:    {use: logger.Mcap, in: all}
"""
    place = tmp_path / "place.yaml"
    place.write_text("a: [source, follow]\nb: [spring]\n")
    launch = LaunchFile(graph=write_graph(tmp_path, text), place=place, duration=5.0, clock="real")
    execute(launch.but(record=tmp_path / "run.mcap"))
    assert any(m.used == (-1,) for m in Recording(tmp_path / "run.mcap").messages("follow"))
    check(tmp_path)


@pytest.mark.parametrize(("how", "where"), [("no memory", "step at tick 299"), ("no memory in start", "start")])
def test_in_one_process_a_memory_error_is_not_attributed_to_a_node(tmp_path, how, where):
    (death,) = go(tmp_path, how, "simulated", place="fused").result.deaths
    assert death.node == "" and death.where == "process" and not death.trace
    assert str(death).startswith("process: there was no memory left while node 'spring' had its turn (" + where)
