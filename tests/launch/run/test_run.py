"""Whole runs: fused, as processes, in random groupings, over TCP; failures of nodes."""

import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from graphs_for_runs import GRAPH, NODES, until_it_is_back, write_graph, write_place

from palpate.engine.job import Job
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run import ending, launcher
from palpate.launch.run.execute import Network, RunOutcome, _reachable, execute
from palpate.launch.run.wire import keys
from palpate.launch.run.wire.addresses import runs
from palpate.launch.run.work.process import _address_towards
from palpate.messages import Torque
from palpate.records.reader import Recording

TICKS = 300


def go(tmp_path: Path, text: str = GRAPH, ticks: int = TICKS, record: bool = True, **more) -> RunOutcome:
    how = {name: more.pop(name) for name in ("patience", "watch") if name in more}
    launch = LaunchFile(
        graph=write_graph(tmp_path, text),
        duration=ticks / 1000.0 if ticks else None,
        record=tmp_path / "run.mcap" if record else None,
        **more,
    )
    return execute(launch, **{"patience": 5.0, **how})


def streams(path: Path) -> dict[str, list[bytes]]:
    payloads: dict[str, list[bytes]] = {}
    for name, _, payload in Recording(path).payloads():
        payloads.setdefault(name, []).append(payload)
    return payloads


def processes() -> set[str]:
    """Fork servers started by this process, and workers without a fork server, from the kernel's process list."""
    pids = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                parent = (entry / "stat").read_text().rpartition(")")[2].split()[1]
            except OSError:
                continue
            if ("palpate.launch.run.forkserver" in line or line.startswith("palpate: ")) and parent in (
                "1",
                str(os.getpid()),
            ):
                pids.add(entry.name)
    return pids


@pytest.fixture(autouse=True)
def nothing_stays():
    before = processes()
    yield
    assert processes() <= before
    assert not [name for name, _ in runs() if name.startswith(f"{os.getpid()}-")]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    outcome = go(folder, place="fused")
    assert outcome.result.ok, outcome.result.deaths
    payloads = streams(folder / "run.mcap")
    assert {name: len(sent) for name, sent in payloads.items()} == dict.fromkeys(NODES, TICKS)
    return payloads


def test_processes_send_the_same_bytes_as_one_process(tmp_path, reference):
    outcome = go(tmp_path)
    assert outcome.result.ok, outcome.result.deaths
    assert streams(tmp_path / "run.mcap") == reference


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_any_grouping_sends_the_same_bytes(tmp_path, reference, seed):
    rng = random.Random(seed)
    names = list(NODES)
    rng.shuffle(names)
    cut = sorted(rng.sample(range(1, len(names)), 2))
    groups = [names[: cut[0]], names[cut[0] : cut[1]], names[cut[1] :]]
    outcome = go(tmp_path, place=write_place(tmp_path, groups))
    assert outcome.result.ok, outcome.result.deaths
    assert streams(tmp_path / "run.mcap") == reference


def test_groups_over_tcp_send_the_same_bytes(tmp_path, reference):
    place = tmp_path / "tcp.yaml"
    place.write_text(
        "a: {nodes: [source, sum], host: 127.0.0.1}\nb: {nodes: [spring, drag, spread], host: 127.0.0.1}\n"
    )
    outcome = go(tmp_path, place=place)
    assert outcome.result.ok, outcome.result.deaths
    assert streams(tmp_path / "run.mcap") == reference


def free_port() -> int:
    """A port that nothing listens on, below those that the system gives to connections: another test in parallel got
    one of these before the run used it."""
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket() as free:
            try:
                free.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port


def with_a_group_joined_by_hand(
    tmp_path, monkeypatch, duration, watch=lambda running, far: None, graph=GRAPH, patience=5.0, stops=False,
    clock="simulated", far="spring, drag, spread", within=(),
):  # fmt: skip
    """The outcome of the run, and the exit code of the group's process, which has no folder in common with the run, as
    on another machine; `watch` also gets this process. `far`: nodes of the group; `within`: command that starts it."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    keys.make()
    place = tmp_path / "joined.yaml"
    here = ", ".join(name for name in NODES if name not in far)
    place.write_text(f"a: {{nodes: [{here}]}}\nfar: {{nodes: [{far}], join: true}}\n")
    address = f"tcp://127.0.0.1:{free_port()}"
    command = [*within, sys.executable, "-m", "palpate.cli", "remote", "join", address, "far"]
    command += ["--trust", "nodes_for_runs"]
    path = os.pathsep.join([str(Path(__file__).parents[2] / "support"), os.environ.get("PYTHONPATH", "")])
    (tmp_path / "there").mkdir(mode=0o700)
    there = {"PYTHONPATH": path, "XDG_RUNTIME_DIR": str(tmp_path / "there")}
    with subprocess.Popen(command, env=os.environ | there, start_new_session=True) as process:
        launch = LaunchFile(
            graph=write_graph(tmp_path, graph), place=place, duration=duration, record=tmp_path / "run.mcap",
            clock=clock,
        )  # fmt: skip
        outcome = execute(
            launch, network=Network(address), watch=lambda running: watch(running, process), patience=patience
        )
        if stops:
            process.kill()
        return outcome, process.wait(60)


def test_a_group_started_by_hand_sends_the_same_bytes(tmp_path, reference, monkeypatch):
    outcome, code = with_a_group_joined_by_hand(tmp_path, monkeypatch, TICKS / 1000)
    assert outcome.result.ok and code == 0, outcome.result.deaths
    assert streams(tmp_path / "run.mcap") == reference


AHEAD = ("unshare", "--time", "--monotonic", "864000", "--fork")
"""Starts a process whose monotonic clock began 10 days earlier, as on another machine."""


@pytest.mark.skipif(
    shutil.which(AHEAD[0]) is None or subprocess.run([*AHEAD, "true"], capture_output=True).returncode != 0,
    reason="a clock as of another machine needs Linux and root",
)
@pytest.mark.parametrize("far", ["spring, drag, spread", "source, sum"])
def test_on_the_real_clock_a_machine_with_another_time_keeps_pace(tmp_path, monkeypatch, far):
    """Its nodes ignored all messages as those of long ago, and a device there left out all ticks."""
    outcome, code = with_a_group_joined_by_hand(tmp_path, monkeypatch, 1.5, clock="real", far=far, within=AHEAD)
    assert outcome.result.ok and code == 0, outcome.result.deaths
    health = outcome.result.health
    assert all(health[name]["steps"] > 500 for name in NODES), health


def test_a_group_on_another_machine_binds_the_address_of_this_machine():
    """The launcher passed its address, which no other machine has."""
    work = [Job("here", ()), Job("far", ()), Job("there", (), host="10.0.0.3")]
    hosts = [job.host for job in _reachable(work, frozenset({"far", "there"}), Network("tcp://192.0.2.1:5600"))]
    assert hosts == ["192.0.2.1", None, "10.0.0.3"]
    assert _address_towards("127.0.0.1") == "127.0.0.1"


def test_ctrl_c_in_a_group_started_by_hand_ends_the_run_with_its_name(tmp_path, monkeypatch):
    asked: list[int] = []

    def interrupted(running: launcher.Launcher, far: subprocess.Popen) -> None:
        if running.result.health.get("spring", {}).get("tick", 0) > 50 and not asked:
            asked.append(far.pid)
            far.send_signal(signal.SIGINT)

    outcome, code = with_a_group_joined_by_hand(tmp_path, monkeypatch, 20.0, interrupted)
    (death,) = outcome.result.deaths
    assert code == 130 and death.node == "spring, drag, spread" and "stopped by its user" in death.text


def test_a_logger_in_a_group_of_nodes_also_reads_other_groups(tmp_path, reference):
    place = tmp_path / "place.yaml"
    place.write_text("a: [source, spring, log]\nb: [drag, spread, sum]\n")
    outcome = go(tmp_path, place=place)
    assert outcome.result.ok, outcome.result.deaths
    assert streams(tmp_path / "run.mcap") == reference
    assert Recording(tmp_path / "run.mcap").counts["sum"] == {"count": TICKS, "lost": 0}


def test_a_slower_node_is_held_at_its_ticks(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Drag,", "nodes_for_runs.Drag, every: 7,")
    results = []
    for place in ("fused", None):
        outcome = go(tmp_path, text, place=place)
        assert outcome.result.ok, outcome.result.deaths
        results.append(streams(tmp_path / "run.mcap"))
    assert results[0] == results[1]
    assert len(results[0]["drag"]) == -(-TICKS // 7)


def test_each_message_names_the_ticks_that_it_was_computed_from(tmp_path):
    go(tmp_path, place="fused")
    messages = {name: list(Recording(tmp_path / "run.mcap").messages(name)) for name in NODES}
    assert [m.used for m in messages["source"]][:3] == [(-1,), (0,), (1,)]
    assert all(m.used == (m.tick, m.tick) for m in messages["spread"])
    assert [m.time for m in messages["sum"]] == [tick * 1_000_000 for tick in range(TICKS)]


def test_the_real_clock_keeps_its_rate(tmp_path):
    outcome = go(tmp_path, clock="real", ticks=500)
    assert outcome.result.ok, outcome.result.deaths
    assert outcome.result.wall > 0.4
    sent = list(Recording(tmp_path / "run.mcap").messages("source"))
    late = [message.time - message.tick * 1_000_000 for message in sent]  # [ns]
    assert min(late) >= 0 and sorted(late)[len(late) // 2] < 1_000_000
    source = outcome.result.health["source"]
    assert source["tick"] == 499
    # Each tick is run or counted as omitted, except those that passed before the first one on a busy machine.
    assert source["steps"] + source["late"] == 500 - sent[0].tick


FAULTS = {
    "raise": "RuntimeError: out of luck",
    "nan": r"Force.force \[N\]: found nan at index 0",
    "type": "answered a dict, expected a Force",
    "input": "answered a Pose, expected a Force",
    "exit": "its process ended: exit code 7",
    "kill": "its process ended: killed by SIGKILL",
    "start": "RuntimeError: cannot start",
}


@pytest.mark.parametrize(
    ("how", "clock"),
    [
        *((how, "simulated") for how in ("raise", "nan", "exit", "kill", "start")),
        ("exit", "real"),
        ("start", "real"),
        *(pytest.param(how, "real", marks=pytest.mark.long) for how in ("raise", "nan", "kill")),
    ],
)
def test_a_failed_node_is_named_with_the_reason(tmp_path, how, clock):
    text = GRAPH.replace("nodes_for_runs.Spring,", f"nodes_for_runs.Faulty, how: {how},")
    outcome = go(tmp_path, text, clock=clock, ticks=3000)
    (death,) = outcome.result.deaths
    assert death.node == "spring"
    assert re.search(FAULTS[how], death.text)
    if how in ("raise", "start"):
        assert "Traceback" in death.trace
    if how != "start":
        assert len(streams(tmp_path / "run.mcap")["source"]) >= 20


@pytest.mark.parametrize("how", ["raise", "nan", "type", "input", "start"])
def test_a_failed_node_of_a_fused_run_is_named(tmp_path, how):
    text = GRAPH.replace("nodes_for_runs.Spring,", f"nodes_for_runs.Faulty, how: {how},")
    outcome = go(tmp_path, text, place="fused")
    (death,) = outcome.result.deaths
    assert death.node == "spring" and re.search(FAULTS[how], death.text)
    assert how == "start" or len(streams(tmp_path / "run.mcap")["source"]) == 20


@pytest.mark.parametrize("clock", ["simulated", "real"])
def test_a_hung_node_is_named_with_its_traceback(tmp_path, clock):
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: hang,")
    outcome = go(tmp_path, text, clock=clock, ticks=0, patience=0.8)
    (death,) = outcome.result.deaths
    assert death.node == "spring" and "hangs" in death.text
    assert "nodes_for_runs.py" in death.trace


def test_waiting_for_the_disk_does_not_count_as_hung(tmp_path):
    """No signal reaches the writing thread, and it continues without help. The main thread waits for it."""
    outcome = go(
        tmp_path, f"{GRAPH}  disk: {{use: nodes_for_runs.AtTheDisk, in: all, pipe: {tmp_path}/pipe}}\n", patience=1.0
    )
    assert outcome.result.ok and len(streams(tmp_path / "run.mcap")["sum"]) == TICKS
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: hang,")
    assert any("hangs" in death.text for death in go(tmp_path, text, patience=0.4).result.deaths)


def interrupted(tmp_path: Path, text: str = GRAPH, tick: int = 400, **more) -> RunOutcome:
    """A run that gets Ctrl-C after this tick."""
    asked: list[int] = []

    def watch(running: launcher.Launcher) -> None:
        reached = running.result.health.get("source", {}).get("tick", -1)
        if reached >= tick and not asked:
            asked.append(reached)
            os.kill(os.getpid(), signal.SIGINT)

    outcome = go(tmp_path, text, ticks=0, watch=watch, **more)
    assert asked and outcome.result.interrupted
    return outcome


def whole(tmp_path: Path, outcome: RunOutcome) -> None:
    """Assert that all streams of the recording end at the same tick."""
    counts = {name: len(sent) for name, sent in streams(tmp_path / "run.mcap").items()}
    assert outcome.ok and not outcome.result.notes, (outcome.result, counts)
    assert set(counts) == set(NODES) and len(set(counts.values())) == 1 and counts["sum"] > 10, counts


def test_ctrl_c_ends_all_streams_at_the_same_tick(tmp_path):
    whole(tmp_path, interrupted(tmp_path))


def test_after_ctrl_c_the_run_waits_for_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(ending, "STOP_PATIENCE", 1.5)
    text = GRAPH.replace("nodes_for_runs.Spring,", f"nodes_for_runs.Faulty, how: disk, at: 300, note: {tmp_path}/note,")
    whole(tmp_path, interrupted(tmp_path, text, tick=295, patience=60.0))


def test_after_ctrl_c_a_hung_node_is_killed_and_named(tmp_path, monkeypatch):
    monkeypatch.setattr(ending, "STOP_PATIENCE", 0.5)
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: hang, at: 300,")
    outcome = interrupted(tmp_path, text, tick=295, patience=60.0)
    assert "spring did not end within 0.5 s and was killed" in outcome.result.notes


def test_a_port_in_use_is_an_error_of_one_line(tmp_path):
    import zmq

    taken = zmq.Context.instance().socket(zmq.REP)
    port = taken.bind_to_random_port("tcp://127.0.0.1")
    place = tmp_path / "tcp.yaml"
    place.write_text(f"a: {{nodes: [source, sum], host: '127.0.0.1:{port}'}}\n")
    outcome = go(tmp_path, place=place)
    taken.close()
    (death,) = outcome.result.deaths
    assert f"cannot bind tcp://127.0.0.1:{port}: Address already in use" in death.text


def test_a_node_with_restart_is_restarted(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: kill, at: 500, restart: true,")
    outcome = go(tmp_path, text, clock="real", ticks=60_000, watch=until_it_is_back("spring"))
    assert {death.node for death in outcome.result.deaths} == {"spring"}
    recording = Recording(tmp_path / "run.mcap")
    begun, *_ = recording.restarted["spring"]  # on a busy machine the new one may also reach its 500th step
    assert max(m.tick for m in recording.messages("spring")) > begun


def test_on_simulated_time_a_death_ends_the_run_despite_restart(tmp_path):
    """The restarted node could not get the missed messages."""
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: kill, restart: true,")
    outcome = go(tmp_path, text, ticks=200_000)
    assert [death.node for death in outcome.result.deaths] == ["spring"]
    assert outcome.result.health["source"]["tick"] < 200_000 - 1


def test_the_recording_has_the_provenance_of_its_run(tmp_path):
    go(tmp_path, place="fused")
    recording = Recording(tmp_path / "run.mcap")
    assert recording.complete
    assert recording.about["ticks"] == TICKS and recording.about["clock"] == "simulated"
    assert recording.counts["sum"] == {"count": TICKS, "lost": 0}
    assert recording.streams["sum"].type is Torque
    assert recording.columns("sum")["torques"].shape == (TICKS, 3)


@pytest.mark.parametrize("ticks", [13, 100])
def test_a_fused_run_counts_all_messages_of_its_logger(tmp_path, ticks):
    outcome = go(tmp_path, ticks=ticks, place="fused")
    messages = sum(len(own) for own in streams(tmp_path / "run.mcap").values())
    assert outcome.result.health["log"]["steps"] == messages > 0
