"""Recordings of sources: every reader gets the bytes of a full recording; differences are reported."""

import json
import random
from pathlib import Path

import pytest
from graphs_for_runs import GRAPH, NODES, until_it_has, write_graph, write_place
from nodes_for_runs import Spring
from short_touch import QUICK
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.execute import execute
from palpate.messages import Force
from palpate.records.compare import compare
from palpate.records.fill import begin_copy, recover, recover_full
from palpate.records.format.head import head_of
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.replay import Replay
from palpate.records.stored import RecordingError, Stored
from palpate.records.verify import verify
from palpate.views.run import Run

runner = CliRunner()
TICKS = 450
BEGIN = QUICK[1]  # near the surface, which is as fine as it ships


def say(*args):
    result = runner.invoke(app, [str(a) for a in args], env={"COLUMNS": "300", "NO_COLOR": "1"})
    return result.exit_code, result.stdout, result.stderr


def record(folder: Path, text: str = GRAPH, only: str | None = "sources", place: Path | str = "fused",
           clock: str = "simulated", ticks: int = TICKS, **more) -> Path:  # fmt: skip
    path = folder / f"{only}.mcap"
    graph = write_graph(folder, text)
    outcome = execute(
        LaunchFile(graph=graph, duration=ticks / 1000, record=path, place=place, only=only, clock=clock), **more
    )
    assert outcome.ok, (outcome.result.deaths, outcome.result.notes)
    return path


def record_live(folder: Path, text: str = GRAPH) -> Path:
    """Record on the real clock until the last node has made 300 steps, late or not."""
    return record(folder, text, clock="real", place=None, ticks=600_000, watch=until_it_has(sum=("steps", 300)))


def rows(path: Path, stored: bool = False) -> list[tuple[str, int, int, bytes]]:
    """All messages, by tick."""
    return sorted((Stored if stored else Recording)(path).raw(), key=lambda row: (row[1], row[0]))


SLOW = GRAPH.replace("in: {pose: source, force: spring}}", "in: {pose: source, force: spring}, every: 7}")


SOURCE = GRAPH.replace("nodes_for_runs.Source,", "nodes_for_runs.Source, every: 7,")


@pytest.mark.parametrize("text", [GRAPH, SLOW, SOURCE], ids=["each tick", "a node each 7th", "the source each 7th"])
@pytest.mark.parametrize("apart", [False, True], ids=["fused", "processes"])
def test_computed_messages_equal_the_recorded_ones_byte_for_byte(tmp_path, text, apart):
    place = write_place(tmp_path, [["source", "spring"], ["drag", "spread", "sum"]]) if apart else "fused"
    sources, whole = record(tmp_path, text, place=place), record(tmp_path, text, "all")
    assert rows(sources) == rows(whole)
    kept = [row for row in rows(sources, stored=True) if row[0] != "source"]
    assert {row[0] for row in kept} == set(NODES) - {"source"} and all(row in rows(whole) for row in kept)
    counts = Stored(sources).counts
    sent = -(-TICKS // 7) if text == SOURCE else TICKS
    assert counts["source"] == {"count": sent, "lost": 0} and counts["spring"] == {"count": 3, "lost": 0}
    assert all(own["lost"] == 0 for own in counts.values())
    assert sources.stat().st_size < whole.stat().st_size / 4


def test_a_run_on_the_real_clock_is_reproduced_exactly(tmp_path):
    sources = record_live(tmp_path)
    heads = [row for row in rows(sources, stored=True) if row[0] == "sum"]
    target, counts, report = recover_full(sources)
    assert report.ok and counts["sum"] == len(heads)
    whole = Recording(target)
    assert whole.complete and not whole.computed
    assert verify(whole, plan_of(whole)).ok, "each message from exactly the messages that it names"
    assert [(m.tick, m.time) for m in whole.messages("sum")] == [row[1:3] for row in heads]


def test_the_kidney_sends_nothing_to_the_recording_and_the_recording_is_complete(tmp_path):
    """Only the logger would read `nodes` and `displacement` of the tissue, so the run does not compute them."""
    path = {}
    for only in ("sources", "all"):
        path[only] = tmp_path / f"{only}.mcap"
        launch = find("kidney").but(duration=0.3, place="fused", record=path[only], only=only, overrides=(BEGIN,))
        outcome = execute(launch)
        assert outcome.ok and (outcome.plan.wanted["tissue"] >= {"displacement"}) == (only == "all")
    assert rows(path["sources"]) == rows(path["all"])
    assert max(len(m.nodes) for m in Recording(path["sources"]).messages("tissue")) > 10


def test_every_reader_receives_the_computed_messages(tmp_path):
    sources, whole = record(tmp_path), record(tmp_path, only="all")
    assert Run(sources).sum.torques.tolist() == Run(whole).sum.torques.tolist()
    for verb in (["echo", "{}", "sum"], ["export", "{}", "--to", "csv", "--out", tmp_path / "csv"]):
        answers = [say(*(path if arg == "{}" else arg for arg in verb)) for path in (sources, whole)]
        assert answers[0][0] == 0 and answers[0] == answers[1]
    code, out, _ = say("replay", sources, "--json")
    assert code == 0
    assert all(
        node == {"messages": TICKS, "differing": 0, "largest": 0.0} for node in json.loads(out)["nodes"].values()
    )
    changed = [
        compare(Recording(path), [["spring.stiffness=7"]], reference=[])[1].report() for path in (sources, whole)
    ]
    assert changed[0]["force_N"] == changed[1]["force_N"] and changed[0]["force_N"]["peak"] > 0
    code, out, _ = say("info", sources)
    assert code == 0 and "1 of 200" in out


def test_the_check_reports_the_result_for_the_stored_messages(tmp_path):
    path = record(tmp_path)
    report = verify(Recording(path), plan_of(Recording(path)))
    assert report.ok and {name: own.checked for name, own in report.nodes.items()} == dict.fromkeys(NODES[1:], 3)
    code, out, _ = say("replay", path, "--check")
    assert code == 0 and "12 messages of 4 nodes computed again: bit-equal" in out


def test_the_source_can_be_played_without_a_computation(tmp_path, monkeypatch):
    path = record(tmp_path)
    monkeypatch.setattr(Spring, "step", None)
    assert len([row for row in Stored(path).raw() if row[0] == "source"]) == TICKS


# -- what does not come out as it was ------------------------------------------------------------------------------


def test_a_difference_in_a_check_is_reported_with_stream_tick_and_versions(tmp_path, monkeypatch):
    """The class has changed since: from its 300th step on, which the check at tick 400 shows."""
    path = record(tmp_path)
    right = rows(path)
    before = Spring.step

    def changed(self, pose) -> Force:
        force = before(self, pose)
        if pose.tick < 300:
            return force
        return Force(force=(force.force[0] + 1e-9, 0.0, 0.0), state="free", energy=0.0)

    monkeypatch.setattr(Spring, "step", changed)
    with pytest.raises(
        RecordingError, match=r"stream 'spring', tick 400, field force\[0\] \[N\].*palpate \d"
    ) as raised:
        list(Recording(path).raw())
    assert "--to mcap --full" in str(raised.value)
    for verb in (["echo", path, "sum"], ["replay", path], ["export", path, "--to", "csv", "--out", tmp_path / "csv"]):
        code, _, err = say(*verb)
        assert code == 1 and "tick 400" in err and "Traceback" not in err
    code, out, _ = say("replay", path, "--check")
    assert code == 1 and "first difference: stream 'spring', tick 400" in out
    code, out, err = say("export", path, "--to", "mcap", "--full")
    assert code == 1 and "tick 400" in err and f"{201 * len(NODES)} messages" in out
    kept = Recording(path.with_name("sources-full.mcap"))
    assert sorted(kept.raw(), key=lambda row: (row[1], row[0])) == [row for row in right if row[1] <= 200]


def test_a_node_that_fails_is_reported(tmp_path, monkeypatch):
    path = record(tmp_path)
    monkeypatch.setattr(Spring, "step", lambda self, pose: 1 / 0)
    code, _, err = say("echo", path, "sum")
    assert code == 1 and "'spring'" in err and "division by zero" in err and "Traceback" not in err


@pytest.mark.parametrize("clock", ["simulated", "real"])
def test_a_file_truncated_anywhere_is_readable_up_to_the_end(tmp_path, clock):
    text = GRAPH.replace("log:    {", "log:    {within: 0, ")  # chunks after each burst, on a fast machine too
    path = record(tmp_path, text) if clock == "simulated" else record_live(tmp_path, text)
    whole, data = rows(path), path.read_bytes()
    begin = data.index(b"msgpack") if b"msgpack" in data else 8000
    draw = random.Random(3)
    found = []
    for k, end in enumerate(draw.randrange(begin, len(data) - 8) for _ in range(5)):
        cut = tmp_path / f"{k}.mcap"
        cut.write_bytes(data[:end])
        try:
            recording = Recording(cut)
        except RecordingError as error:
            assert "nothing to recover" in str(error)
            continue
        got = sorted(recording.raw(), key=lambda row: (row[1], row[0]))
        assert got == whole[: len(got)] and not recording.complete
        target, _ = recover(cut)
        assert sorted(Recording(target).raw(), key=lambda row: (row[1], row[0])) == got
        found.append(len(got))
    assert max(found) > 100, (len(whole), found)


def test_a_truncated_and_recovered_live_recording_computes_to_its_last_complete_tick(tmp_path):
    """Messages of a node can be in the file before those that it used: processes send them in bursts of ticks."""
    path = record_live(tmp_path)
    whole = rows(path)
    bursts = sorted(rows(path, stored=True), key=lambda row: (row[1] // 16, -NODES.index(row[0]), row[1]))
    named = 0
    for count in random.Random(5).sample(range(40, len(bursts)), 25):
        arrived = bursts[:count]
        truncated = rewritten(tmp_path / "cut.mcap", Stored(path), arrived, {"recovered_from": "run.mcap"})
        got = rows(truncated)
        assert got == whole[: len(got)]
        complete = min(max((t for name, t, *_ in arrived if name == node), default=-1) for node in NODES)
        assert not got or got[-1][1] >= complete - 16
        report = verify(Recording(truncated), plan_of(Recording(truncated)))
        assert report.cut and report.first is None
        gaps = [node.stopped for node in report.nodes.values() if node.stopped]
        assert len(gaps) <= 1 and all("is not in the truncated file" in gap for gap in gaps)
        named += len(gaps)
        player = Replay(Recording(truncated), plan_of(Recording(truncated)))
        player.run()
        assert all(node.differing == 0 for node in player.reports.values()) and not player.player.substituted
    assert named > 5


def test_a_lost_live_message_without_dependents_is_the_only_missing_one(tmp_path):
    path = record_live(tmp_path)
    own = [row for row in rows(path) if row[0] == "sum"]
    gone = own[2 * len(own) // 3]  # a busy machine leaves out ticks
    assert rows(without(path, gone[:2])) == [row for row in rows(path) if row != gone]


def without(path: Path, *gone: tuple[str, int]) -> Path:
    """The same recording without messages that did not reach the logger."""
    recording = Stored(path)
    left = [row for row in recording.raw() if row[:2] not in gone]
    return rewritten(path.with_name("holed.mcap"), recording, left, {})


def rewritten(target: Path, recording: Stored, left: list[tuple[str, int, int, bytes]], more: dict[str, str]) -> Path:
    """A complete file with these messages, and more about the run."""
    with target.open("wb") as file:
        writer, channels = begin_copy(recording, file, {**recording.about, **more})
        for name, tick, time, payload in left:
            writer.add_message(channels[name], tick, time, payload)
        writer.finish()
    return target


def test_a_logger_in_the_process_of_a_node_receives_the_others_to_their_end_on_the_real_clock(tmp_path):
    """What a node used is in the file, though the others send to observers in bursts of ticks."""
    place = write_place(tmp_path, [["source", "spring"], ["drag", "spread", "sum", "log"]])
    for name in ("a", "b", "c"):  # how much of the last burst is left depends on the moment
        folder = tmp_path / name
        folder.mkdir()
        path = record(folder, clock="real", place=place, ticks=205)
        there = {row[:2] for row in rows(path, stored=True)}
        drag = [row for row in rows(path, stored=True) if row[0] == "drag"]
        used = {tick for row in drag for tick in head_of(row[3]).used}
        assert drag and {("source", tick) for tick in used if tick >= 0} <= there
        assert {row[:2] for row in rows(path)} >= there  # computes the other streams, and reports missing messages


def test_a_source_with_a_missing_message_is_an_error(tmp_path):
    with pytest.raises(RecordingError, match="'source' has no message of tick 333"):
        list(Recording(without(record(tmp_path), ("source", 333))).raw())


@pytest.mark.parametrize("stream", ["source", "spring"])
def test_losses_of_a_live_run_are_reported_and_the_part_before_is_readable(tmp_path, stream):
    path = record_live(tmp_path)
    right = rows(path)
    own = [row[1] for row in right if row[0] == stream]
    tick = own[2 * len(own) // 3]
    holed = without(path, (stream, tick))
    with pytest.raises(RecordingError, match=r"stream '\w+', tick \d+") as raised:
        list(Recording(holed).raw())
    assert "Traceback" not in str(raised.value) and "--to mcap --full" in str(raised.value)
    target, _, report = recover_full(holed)
    got = rows(target)
    assert not report.ok and got == right[: len(got)] and 0 < got[-1][1] < tick


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        (GRAPH.replace("force: spring}}", "force: spring}, restart: true}"), {}, ["'drag'", "may be restarted"]),
        (GRAPH, {"leave_out": ["source"]}, ["'source'", "left out"]),
        (GRAPH, {"thin": {"drag": 3}}, ["'log'", "thin: drag", "computed"]),
    ],
)
def test_a_graph_that_cannot_be_recomputed_requires_record_all(tmp_path, text, more, words):
    with pytest.raises(GraphError) as raised:
        record(tmp_path, text, **more)
    assert all(word in str(raised.value) for word in [*words, "record: all"])
    assert not (tmp_path / "sources.mcap").exists()


def test_streams_that_are_left_out_stay_out(tmp_path):
    path = record(tmp_path, leave_out=["spread"])
    assert {row[0] for row in rows(path)} == set(NODES) - {"spread"}


@pytest.mark.parametrize(
    ("given", "file", "only"),
    [("sources", "run.mcap", "sources"), ("all", "run.mcap", "all"), ("a/b.mcap", "a/b.mcap", None)],
)
def test_a_launch_file_sets_what_to_record(tmp_path, given, file, only):
    write_graph(tmp_path)
    (tmp_path / "run.yaml").write_text(f"graph: loop.yaml\nrecord: {given}\n")
    launch = find(str(tmp_path / "run.yaml"))
    assert (launch.record, launch.only) == (Path(file), only)


def test_an_unknown_value_is_an_error(tmp_path):
    graph = write_graph(tmp_path)
    (tmp_path / "run.yaml").write_text("graph: loop.yaml\nrecord: source\n")
    with pytest.raises(GraphError, match=r"run\.yaml:2: record: found 'source'.*\n.*Did you mean 'sources'"):
        find(str(tmp_path / "run.yaml"))
    code, _, err = say("run", graph, "--record-only", "everything", "--record", tmp_path / "a.mcap")
    assert code == 2 and "expected all or sources" in err


def test_recover_full_of_a_complete_recording_is_an_error(tmp_path):
    code, _, err = say("export", record(tmp_path, only="all"), "--to", "mcap", "--full")
    assert code == 2 and "contains all messages" in err
