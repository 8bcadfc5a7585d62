"""Recording: what survives a kill and a full disk, what is counted, left out and thinned; the errors of bad files."""

import functools
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated

import pytest
from graphs_for_runs import GRAPH, NODES, write_graph
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner
from warm_fork_server import started_in

import palpate
from palpate import messages
from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.execute import execute
from palpate.messages import DeviceState, Health, Message, pack
from palpate.nodes.base import Stream
from palpate.nodes.logger import Mcap
from palpate.records.fill import recover
from palpate.records.format.mcap_append import append_metadata
from palpate.records.format.mcap_file import LIBRARY, SEAL, McapRecords
from palpate.records.format.mcap_writer import CHUNK_SIZE, IN_FLIGHT
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError
from palpate.records.verify import verify

ENV = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1] / "support"), os.environ.get("PYTHONPATH", "")]),
}
RUN = """
import resource, sys
from pathlib import Path
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
graph, file, seconds, place, limit, clock = sys.argv[1:]
if int(limit):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), resource.RLIM_INFINITY))
launch = LaunchFile(graph=Path(graph), duration=float(seconds), record=Path(file), place=place or None, clock=clock)
outcome = execute(launch)
print(outcome.result.ticks, outcome.result.ok)
print("\\n".join(outcome.result.notes))
"""
runner = CliRunner()


def say(*args):
    """Exit code, output and error text of a command."""
    result = runner.invoke(app, [str(a) for a in args], env={"COLUMNS": "300", "NO_COLOR": "1"})
    return result.exit_code, result.stdout, result.stderr


def record(folder: Path, text: str = GRAPH, ticks: int = 200, **more) -> Path:
    path = folder / "run.mcap"
    outcome = execute(
        LaunchFile(graph=write_graph(folder, text), duration=ticks / 1000, record=path, place="fused"), **more
    )
    assert outcome.result.ok, outcome.result.deaths
    return path


def start(folder: Path, seconds: float, place: str = "", limit: int = 0, clock: str = "simulated") -> subprocess.Popen:
    graph = write_graph(folder, GRAPH.replace("log:    {", "log:    {compression: none, " if limit else "log:    {"))
    args = [str(graph), str(folder / "run.mcap"), str(seconds), place, str(limit), clock]
    env = ENV | {"PALPATE_TEST": str(folder)}
    return subprocess.Popen([sys.executable, "-c", RUN, *args], env=env, stdout=subprocess.PIPE, text=True)


@pytest.mark.parametrize("place", ["", "fused"])
def test_a_killed_run_leaves_a_readable_file_that_lacks_one_second_at_most(tmp_path, place):
    path = tmp_path / "run.mcap"
    clock = "real" if place == "" else "simulated"
    with start(tmp_path, 600, place, clock=clock) as process:
        until = time.monotonic() + 60
        while not (path.exists() and path.stat().st_size > 60_000) and time.monotonic() < until:
            time.sleep(0.05)
        alive = 0.0  # [s] in which the machine runs
        while alive < (1.3 if place == "" else 0.2):
            begun = time.monotonic()
            time.sleep(0.02)
            alive += min(time.monotonic() - begun, 0.05)
        process.send_signal(signal.SIGKILL)
    until = time.monotonic() + 60
    while started_in(tmp_path, f"PALPATE_TEST={tmp_path}") and time.monotonic() < until:  # its workers
        time.sleep(0.01)
    recording = Recording(path)
    assert not recording.complete and recording.about["clock"] == clock
    last = max(m.time for m in recording.messages("source")) * 1e-9
    assert last > 0
    if clock == "real":
        assert last > alive - 1.0
    report = verify(recording, plan_of(recording))
    assert report.ok and report.cut
    assert recording.counts == {}


def test_a_killed_logger_leaves_a_readable_file_and_the_run_continues(tmp_path):
    path = tmp_path / "run.mcap"
    text = GRAPH.replace("logger.Mcap,", "nodes_for_recording.Dying, at: 900,")
    outcome = execute(LaunchFile(graph=write_graph(tmp_path, text), duration=1.5, clock="real", record=path))
    (death,) = outcome.result.deaths
    assert death.node == "log" and "SIGKILL" in death.text
    assert outcome.result.ticks > 1400
    recording = Recording(path)
    assert not recording.complete
    assert max(m.time for m in recording.messages("source")) > 0


def test_streams_are_left_out_and_thinned_by_the_graph_and_by_the_command_together(tmp_path):
    text = GRAPH.replace("log:    {", "log:    {leave_out: [drag], ")
    record(tmp_path, text, leave_out=["spread"], thin={"sum": 10})
    recording = Recording(tmp_path / "run.mcap")
    assert set(recording.streams) == {"source", "spring", "sum"}
    assert [m.tick for m in recording.messages("sum")] == list(range(0, 200, 10))
    assert recording.streams["sum"].thin == 10 and recording.counts["sum"] == {"count": 20, "lost": 0}
    code, out, _ = say("info", tmp_path / "run.mcap", "--json")
    data = json.loads(out)
    assert code == 0 and data["left_out"] == ["drag", "spread"]
    assert {s["name"]: s["thin"] for s in data["streams"]} == {"source": 1, "spring": 1, "sum": 10}


def test_the_command_line_leaves_out_and_thins(tmp_path):
    graph = write_graph(tmp_path)
    code, _, err = say("run", graph, "--fused", "--duration", "0.1", "--record", tmp_path / "a.mcap", "--no-pictures",
                         "--leave-out", "spread", "--thin", "drag=5", "-q")  # fmt: skip
    assert code == 0, err
    recording = Recording(tmp_path / "a.mcap")
    assert "spread" not in recording.streams and recording.counts["drag"]["count"] == 20
    code, _, err = say("run", graph, "--fused", "--record", tmp_path / "b.mcap", "--leave-out", "spreed")
    assert code == 2 and "Did you mean 'spread'" in err
    code, _, err = say("run", graph, "--thin", "drag")
    assert code == 2 and "STREAM=N" in err


def test_an_unknown_stream_cannot_be_left_out(tmp_path):
    with pytest.raises(GraphError, match="no stream 'spreed'"):
        record(tmp_path, leave_out=["spreed"])


def test_a_stream_that_the_plan_leaves_out_can_be_left_out_and_thinned(tmp_path):
    other = "  other: {use: nodes_for_runs.Spring, in: {pose: source}, when: tissue.other}\n  log:"
    text = "scene: {tissue: {other: false}}\n" + GRAPH.replace("  log:", other)
    for more in ({"leave_out": ["other"]}, {"thin": {"other": 3}}):
        recording = Recording(record(tmp_path, text, **more))
        assert "other" not in recording.streams and recording.counts["source"]["count"] == 200


def logger(path: Path, **given) -> Mcap:
    node = Mcap(path=str(path), **given)
    node.listen((Stream("device", DeviceState, "device", 1), Stream("slow", DeviceState, "slow", 10)), {"plan": {}})
    node.start()
    return node


def health(node: str, steps: int, since: int = 0) -> Health:
    counts = {"since": since, "steps": steps, "late": 0, "lost": 0, "held": 0}
    return Health(source=node, **counts, state="", median=0, p99=0, longest=0, age=0)


def test_lost_messages_are_counted_from_the_counters_of_the_senders(tmp_path):
    """A tick that the clock left out was never sent: it is a gap, but nothing is lost."""
    node = logger(tmp_path / "a.mcap")
    node.health(health("device", 0))
    for tick in (0, 1, 2, 5, 6, 9):  # 3, 4 left out by the clock; 7 and 8 lost on the way
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 8))
    for tick in (0, 30):
        node.observe("slow", tick, pack(DeviceState(tick=tick, time=tick)))
    node.stop()
    counts = Recording(tmp_path / "a.mcap").counts
    assert counts["device"] == {"count": 6, "lost": 2}
    assert counts["slow"] == {"count": 2, "lost": 2}, "without word from the sender each tick without message counts"
    (line,) = node.notes()
    assert "device 2" in line and "slow 2" in line


def test_a_restart_of_a_node_is_marked_at_its_position(tmp_path):
    node = logger(tmp_path / "a.mcap")
    node.health(health("device", 0))
    for tick in range(5):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 5))
    node.health(health("device", 0, since=38))
    for tick in range(40, 44):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 4, since=38))
    node.stop()
    recording = Recording(tmp_path / "a.mcap")
    assert recording.restarted == {"device": [38]} and recording.counts["device"]["lost"] == 0


def test_a_late_report_of_a_restart_marks_no_other_position(tmp_path):
    """A logger receives messages and health of nodes on two paths, so in any order."""
    node = logger(tmp_path / "a.mcap")
    for tick in range(5):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 0))
    node.health(health("device", 7))  # two messages are lost
    for tick in range(40, 44):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 0, since=39))
    node.health(health("device", 6))  # late, of the dead predecessor
    node.health(health("device", 5, since=39))
    node.stop()
    recording = Recording(tmp_path / "a.mcap")
    assert recording.restarted == {"device": [39]}
    assert recording.counts["device"] == {"count": 9, "lost": 1}, "the restarted node only"


@pytest.mark.parametrize(("first", "since", "marked", "late"), [
    (0, 1500, {"device": [1500]}, {}), (7, 7, {}, {"device": 7}), (2000, 1500, {}, {"device": 1500}),
])  # fmt: skip
def test_the_first_report_of_a_node_may_be_that_after_its_restart(tmp_path, first, since, marked, late):
    """Its first health was lost, or it died before it: messages from before the restart show that it ran before."""
    node = logger(tmp_path / "a.mcap")
    for tick in range(first, 3500):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 3500 - max(first, since), since=since))
    node.stop()
    recording = Recording(tmp_path / "a.mcap")
    assert (recording.restarted, recording.late) == (marked, late)
    assert recording.counts["device"] == {"count": 3500 - first, "lost": 0}


def test_a_recording_that_began_after_a_node_does_not_say_that_the_node_began_late(tmp_path):
    node = logger(tmp_path / "a.mcap")
    for tick in range(5000, 5500):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 4000, since=1500))
    node.stop()
    assert Recording(tmp_path / "a.mcap").late == {}


def test_a_restart_is_marked_also_if_more_messages_are_lost_after_it_than_sent_before_it(tmp_path):
    node = logger(tmp_path / "a.mcap")
    for tick in (0, *range(1500, 3500)):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 2010, since=1500))
    node.stop()
    recording = Recording(tmp_path / "a.mcap")
    assert recording.restarted == {"device": [1500]} and recording.counts["device"]["lost"] == 10


def test_a_last_report_of_a_dead_node_is_ignored(tmp_path):
    node = logger(tmp_path / "a.mcap")
    node.health(health("device", 0))
    node.health(health("device", 0, since=39))
    for tick in range(40, 44):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.health(health("device", 5, since=39))
    node.health(health("device", 38))
    node.stop()
    assert Recording(tmp_path / "a.mcap").counts["device"] == {"count": 4, "lost": 1}


def test_a_skipped_tick_is_replaced_by_the_next_one_without_a_shift_of_the_thinning(tmp_path):
    node = logger(tmp_path / "a.mcap", thin={"device": 3})
    for tick in (0, 1, 2, 4, 5, 6, 7, 8, 11, 12):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
    node.stop()
    assert [m.tick for m in Recording(tmp_path / "a.mcap").messages("device")] == [0, 4, 6, 11, 12]


@pytest.mark.parametrize(
    ("library", "data"), [(LIBRARY, {"plan": "{}"}), (LIBRARY, {"plan": "{}", SEAL: "0"}), ("other", {SEAL: "0"})]
)
def test_metadata_with_a_missing_or_wrong_checksum_are_damaged(tmp_path, library, data):
    with open(tmp_path / "a.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="palpate", library=library)
        writer.add_metadata("palpate.about", data)
        writer.finish()
    with pytest.raises(RecordingError, match=r"metadata 'palpate\.about' do not match their checksum"):
        Recording(tmp_path / "a.mcap").about  # noqa: B018


def test_memory_stays_bounded(tmp_path):
    """A hundred thousand messages: what the writer holds is a few chunks, and the index of those that it wrote."""
    import tracemalloc

    node = logger(tmp_path / "a.mcap")
    payload = pack(DeviceState(joints=(0.1, 0.2, 0.3)))

    def held(ticks):
        """[B] once these ticks are in the file, and the most that was held meanwhile."""
        tracemalloc.reset_peak()
        for tick in ticks:
            node.observe("device", tick, payload)
        peak = tracemalloc.get_traced_memory()[1]
        node._writer.flush()
        return tracemalloc.get_traced_memory()[0], peak

    tracemalloc.start()
    try:
        before, _ = held(range(20_000))
        after, peak = held(range(20_000, 120_000))
    finally:
        tracemalloc.stop()
        node.stop()
    assert after - before < 300_000
    assert peak - before < 4 * (IN_FLIGHT + 2) * CHUNK_SIZE  # as objects a message takes up to three times its bytes


def test_the_reader_of_the_authors_of_mcap_opens_a_recording(tmp_path):
    path = record(tmp_path)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 200 * len(NODES)
        topics = {channel.topic for _, channel, _ in reader.iter_messages()}
    assert topics == set(NODES)
    assert summary.statistics.chunk_count >= 1
    schema = next(s for s in summary.schemas.values() if s.name == "Torque")
    assert json.loads(schema.data)["properties"]["torques"]["unit"] == "N m"


def test_the_msgpack_package_reads_the_wire_bytes(tmp_path):
    msgpack = pytest.importorskip("msgpack")
    path = record(tmp_path)
    _, _, payload = next(Recording(path).payloads("sum"))
    assert set(msgpack.unpackb(payload)) == {"tick", "time", "source", "used", "torques"}


# -- bad files -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> bytes:
    folder = tmp_path_factory.mktemp("good")
    path = record(folder, GRAPH.replace("log:    {", "log:    {compression: none, "), ticks=1500)
    return path.read_bytes()


@pytest.mark.parametrize("part", [0.97, 0.5])
def test_a_file_truncated_anywhere_is_read_up_to_its_last_complete_chunk_and_recovered(tmp_path, good, part):
    path = tmp_path / "cut.mcap"
    path.write_bytes(good[: int(len(good) * part)])
    recording = Recording(path)
    assert set(recording.streams) == set(NODES)
    whole = list(recording.raw())
    assert not recording.complete and len(whole) > 1000
    assert verify(recording, plan_of(recording)).ok
    code, out, _ = say("info", path)
    assert code == 0 and "--to mcap`" in out
    target, counts = recover(path)
    again = Recording(target)
    assert again.complete and list(again.raw()) == whole and sum(counts.values()) == len(whole)
    with open(target, "rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == len(whole)
    assert say("export", path, "--to", "mcap")[0] == 2  # the recovered file exists already
    for file in (path, target):  # each lacks the end of the run
        code, out, _ = say("replay", file, "--check")
        until = re.search(r"not the whole run: verified: 0 to (\d+\.\d+) s", " ".join(out.split()))
        assert code == 1 and until and 0.0 < float(until[1]) <= max(time for _, _, time, _ in whole) * 1e-9


def test_a_damaged_chunk_ends_the_reading_and_nothing_wrong_is_read(tmp_path, good):
    path = tmp_path / "bad.mcap"
    path.write_bytes(good)
    with path.open("rb") as file:
        begins = [at for at, _ in McapRecords(file).chunks()]
    at = begins[-1] + 200  # within what is packed in it
    path.write_bytes(good[:at] + bytes([good[at] ^ 0xFF]) + good[at + 1 :])
    recording = Recording(path)
    read_back = list(recording.raw())
    assert not recording.complete and len(read_back) < 1500 * len(NODES)
    assert bool(read_back) == (len(begins) > 1)


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    """A recording with one of everything that the format has, as small as it gets."""
    folder = tmp_path_factory.mktemp("small")
    text = GRAPH.replace("log:    {", "log:    {within: 0, ").replace("Spread,", "Spread, count: 3,")
    return record(folder, text, ticks=40)


def everything(recording: Recording) -> tuple[object, ...]:
    return recording.streams, recording.about, recording.counts, recording.restarted, recording.late


@pytest.mark.parametrize("seeds", [range(90), pytest.param(range(90, 600), marks=pytest.mark.long)])
def test_a_flipped_bit_anywhere_is_reported_or_harmless(small, tmp_path, seeds):
    """No message is read that was not written; unreadable parts are reported with their position."""
    for seed in seeds:
        data = bytearray(small.read_bytes())
        draw = random.Random(seed)
        # two of three are before or after the messages, in schemas, channels, metadata and the index
        ends = [*range(8, 6000), *range(len(data) - 6000, len(data))]
        at = draw.choice(ends) if seed % 3 else draw.randrange(len(data))
        data[at] ^= 1 << draw.randrange(8)
        told_or_harmless(small, data, tmp_path)


def test_a_record_of_another_kind_or_length_is_an_error(small, tmp_path):
    """A flipped bit in the byte that says what a record is: a chunk of messages becomes an index of messages. Or in its
    length: it swallows the records behind it, and what follows may fit by chance."""
    data = small.read_bytes()
    places, at = {}, 8
    while data[at] != 15:  # the end of the data
        places.setdefault(data[at], []).append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    assert len(places[6]) > 3 and len(places[7]) > 3
    for starts in places.values():
        for place in starts[:2]:
            for bit in range(24):
                flipped = bytearray(data)
                flipped[place + bit // 8] ^= 1 << bit % 8
                told_or_harmless(small, flipped, tmp_path)
    chunk = places[6][1]
    for end in places[6][2:12]:  # the chunk's length leads to another record's beginning
        flipped = bytearray(data)
        flipped[chunk + 1 : chunk + 9] = (end - chunk - 9).to_bytes(8, "little")
        told_or_harmless(small, flipped, tmp_path)


@functools.cache
def read(path: Path) -> tuple[Recording, list[tuple]]:
    """A recording and all its messages."""
    recording = Recording(path)
    return recording, list(recording.raw())


def told_or_harmless(small: Path, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    path.write_bytes(data)
    good, whole = read(small)
    try:
        recording = Recording(path)
    except RecordingError as error:
        assert "damaged" in str(error) or "not an MCAP file" in str(error) or "cut off" in str(error)
        return
    read_back = list(recording.raw())
    assert not recording.complete and "byte" in recording.ending and "--to mcap`" in recording.ending
    assert read_back == whole[: len(read_back)]
    assert {name: good.streams[name].schema for name in recording.streams} == {
        name: stream.schema for name, stream in recording.streams.items()
    }
    assert recording.about == good.about and recording.counts in ({}, good.counts)
    (tmp_path / "recovered.mcap").unlink(missing_ok=True)
    target, counts = recover(path, tmp_path / "recovered.mcap")
    again = Recording(target)
    assert again.complete and list(again.raw()) == read_back and sum(counts.values()) == len(read_back)
    assert again.about == {**good.about, "recovered_from": str(path)}


@pytest.mark.parametrize("part", [0.005, 0.3, 0.6, 0.995])
def test_every_command_reports_damage_without_a_traceback(small, tmp_path, part):
    data = bytearray(small.read_bytes())
    data[int(len(data) * part)] ^= 0x10
    path = tmp_path / "bad.mcap"
    path.write_bytes(data)
    for verb in (["info"], ["replay", "--check"], ["replay"], ["export", "--to", "csv", "--out", tmp_path / "csv"],
                 ["export", "--to", "mcap"]):  # fmt: skip
        code, out, err = say(verb[0], path, *verb[1:])
        printed = " ".join((out + err).split())
        assert "Traceback" not in printed and (code == 2 or "mcap" in verb or "at byte" in printed), (verb, printed)
        assert code == 0 or f"{path}" in printed


def test_messages_older_than_the_setting_within_are_in_the_file(tmp_path):
    """Everything is killed at once: what came longer ago than `within` is in the file."""
    node = logger(tmp_path / "a.mcap", within=0.0)
    for tick in range(7):
        node.observe("device", tick, pack(DeviceState(tick=tick, time=tick)))
        assert [each[1] for each in Recording(tmp_path / "a.mcap").raw()] == [*range(tick + 1)]
    node.stop()


def test_a_stream_of_another_graph_is_an_error(tmp_path):
    path = tmp_path / "a.mcap"
    node = Mcap(path=str(path))
    node.listen((Stream("devise", DeviceState, "devise", 1),), {"plan": {"nodes": [{"name": "device"}]}})
    node.start()
    node.stop()
    with pytest.raises(RecordingError, match="'devise' of node 'devise', which the recorded graph does not have"):
        Recording(path)


def test_two_types_of_one_name_are_both_recovered(tmp_path):
    class DeviceState(Message):
        more: Annotated[float, "m"]

    path = tmp_path / "a.mcap"
    node = Mcap(path=str(path))
    node.listen((Stream("a", messages.DeviceState, "a", 1), Stream("b", DeviceState, "b", 1)), {"plan": {}})
    node.start()
    node.stop()
    again = Recording(recover(path)[0])
    assert again.streams["a"].schema != again.streams["b"].schema == Recording(path).streams["b"].schema


def foreign(path: Path, version: str = "1", profile: bool = True) -> Path:
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        if profile:
            writer.add_metadata("palpate.about", {"plan": "{}"})
        text = json.dumps({"title": "X", "class": "no_such_module.X", "version": version}).encode()
        schema = writer.register_schema("X", "jsonschema", text)
        writer.register_channel("x", "msgpack", schema, {"producer": "x", "every": "1"})
        writer.finish()
    return path


def test_a_file_that_is_not_a_recording_is_an_error_of_one_line(tmp_path):
    (tmp_path / "text.mcap").write_text("hello")
    (tmp_path / "empty.mcap").write_text("")
    cases = {
        tmp_path / "missing.mcap": "No such file",
        tmp_path / "text.mcap": "not an MCAP file",
        tmp_path / "empty.mcap": "an empty file",
        tmp_path: "a folder, expected a recording",
        foreign(tmp_path / "other.mcap", profile=False): "an MCAP file of another program",
        foreign(tmp_path / "new.mcap", version="99"): "schema version '99', this palpate reads '1'",
    }
    for path, words in cases.items():
        for verb in (["info"], ["replay"], ["echo", "{}", "x"], ["export", "{}", "--to", "csv"],
                     ["export", "{}", "--to", "mcap"], ["compare", "{}", "--set", "a.b=1"]):  # fmt: skip
            args = [str(path) if a == "{}" else a for a in verb] if "{}" in verb else [*verb, path]
            code, _, err = say(*args)
            assert code == 2 and words in err and "Traceback" not in err, (args, err)
            assert len(err.strip().splitlines()) == 1


def test_the_rest_is_readable_after_the_removal_of_a_message_type(tmp_path):
    path = foreign(tmp_path / "a.mcap")
    assert say("info", path)[0] == 0
    code, _, err = say("echo", path, "x")
    assert code == 2 and "no_such_module.X" in err and "can be read" in err


def test_an_unknown_stream_is_an_error_with_the_most_similar_name(tmp_path):
    path = record(tmp_path)
    code, _, err = say("echo", path, "sprong")
    assert code == 2 and "Did you mean 'spring'" in err
    code, _, err = say("echo", path)
    assert code == 2 and "name a stream" in err


def test_a_payload_of_the_wrong_type_is_an_error_with_the_stream(tmp_path):
    path = tmp_path / "a.mcap"
    node = logger(path)
    node.observe("device", 0, pack(DeviceState(tick=0, time=0)).replace(b"homed", b"humed"))
    node.observe("device", 1, pack(DeviceState(tick=1, time=1)).replace(b"homed\xc3", b"homed\x01"))
    node.stop()
    recording = Recording(path)
    assert next(recording.messages("device")).homed  # an unknown field is no fault: a newer sender may have it
    with pytest.raises(RecordingError, match=r"stream 'device'.*not a DeviceState"):
        list(recording.messages("device"))
    with pytest.raises(RecordingError, match="no stream"):
        next(recording.payloads("nothing"))


@pytest.mark.parametrize("record", ["all", "sources"])
def test_the_notes_of_a_run_are_in_its_recording(tmp_path, record):
    """With the node and the time; the file stays complete, and its other records are as before."""
    file = tmp_path / "touch.mcap"
    stiff = find("kidney").but(overrides=["tissue.stiffness=9e3", "scene.hand.begin=[0, 0, 0.1085]"], duration=0.1)
    outcome = execute(stiff.but(record=file, place="fused", only=None if record == "all" else record))
    run = palpate.open(file)
    assert run.notes == outcome.notes and any("stiffer than" in note for note in run.notes)
    assert [(n.node, n.time) for n in run.notes] == [(n.node, n.time) for n in outcome.notes]
    assert not run._recording.ending and not outcome.lacking
    with open(file, "rb") as opened:
        summary = make_reader(opened, validate_crcs=True).get_summary()
        assert summary.statistics.metadata_count == len(summary.metadata_indexes)
        messages = [message.data for *_, message in make_reader(opened, validate_crcs=True).iter_messages()]
    for number in range(3):
        append_metadata(file, f"more-{number}", {"text": "a" * number})
    with open(file, "rb") as opened:
        reader = make_reader(opened, validate_crcs=True)
        assert [message.data for *_, message in reader.iter_messages()] == messages
        assert [each.name for each in reader.iter_metadata()][-3:] == ["more-0", "more-1", "more-2"]
    assert palpate.open(file).notes == run.notes


def test_notes_are_not_added_to_a_file_without_its_end(tmp_path, short_kidney):
    whole = short_kidney.read_bytes()
    for count in (0, 8, 100, len(whole) // 2, len(whole) - 1):
        file = tmp_path / "cut.mcap"
        file.write_bytes(whole[:count])
        with pytest.raises(ValueError, match="found no"):
            append_metadata(file, "palpate.notes", {"notes": "[]"})
        assert file.read_bytes() == whole[:count]


def test_several_streams_are_read_in_one_pass(short_kidney):
    """The tables of all streams, whole and within times, have the fields of their messages; texts on demand."""
    recording = Recording(short_kidney)
    for within in (None, (0.01, 0.02)):
        every = recording.tables(recording.streams, within, texts=True)
        for name, columns in every.items():
            sent = list(recording.messages(name, within))
            assert sent and [message.tick for message in sent] == columns["tick"].tolist()
            for field in columns.keys() - {"tick", "time"}:
                assert columns[field].tolist() == [
                    list(value) if isinstance(value := getattr(message, field), tuple) else value for message in sent
                ]
    texts = [message.state for message in recording.messages("controller")]
    assert recording.tables(["controller"], texts=True)["controller"]["state"].tolist() == texts
    assert "state" not in recording.columns("controller")
