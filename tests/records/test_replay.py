"""Replay: bit for bit, of simulated and live runs, whole and in part; and what it says where a byte differs."""

import json
import shutil
from pathlib import Path

import msgspec
import pytest
from graphs_for_runs import GRAPH, NODES, until_it_has, until_it_is_back, write_graph, write_place
from mcap.writer import Writer
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import RunOutcome, execute
from palpate.launch.run.result import Result
from palpate.messages import Load, pack, unpack
from palpate.records import segment_player
from palpate.records.changed import change_plan, sources
from palpate.records.compare import compare
from palpate.records.differences import Report
from palpate.records.fill import begin_copy, write_json
from palpate.records.format.mcap_file import lacking
from palpate.records.player import Player, plan_of
from palpate.records.reader import Recording
from palpate.records.replay import Replay
from palpate.records.segment_player import SegmentPlayer, live_player
from palpate.records.stored import RecordingError, Stored
from palpate.records.verify import verify

HERE = Path(__file__).parents[1]
runner = CliRunner()
# A graph whose messages come late, held, lost and not at all when it runs on the real clock of a busy machine.
BAD_DAY = (
    GRAPH.replace("nodes_for_runs.Drag,", "nodes_for_recording.SlowDrag,")
    .replace("nodes_for_runs.Spread,", "nodes_for_runs.Spread, every: 3,")
    .replace("nodes_for_runs.Source,", "nodes_for_recording.Wanderer,")
)


def say(*args, stdin: str | None = None):
    result = runner.invoke(app, [str(a) for a in args], env={"COLUMNS": "300", "NO_COLOR": "1"}, input=stdin)
    return result.exit_code, result.stdout, result.stderr


def record(folder: Path, text: str = GRAPH, ticks: int = 200, **more) -> Path:
    path = folder / "run.mcap"
    place = more.pop("place", "fused")
    how = {"watch": more.pop("watch")} if "watch" in more else {}
    launch = LaunchFile(graph=write_graph(folder, text), duration=ticks / 1000, record=path, place=place, **more)
    outcome = execute(launch, **how)
    assert outcome.result.ok, outcome.result.deaths
    return path


def record_live(folder: Path, steps: int, **more) -> Path:
    """Record a disturbed run on the real clock until the nodes have made `steps` steps (`sum`: a third)."""
    enough = until_it_has(source=("steps", steps), drag=("steps", steps), sum=("steps", steps // 3))
    return record(folder, BAD_DAY, ticks=600_000, clock="real", watch=enough, **more)


def check(path: Path, *sets: str, tolerance: float = 0.0) -> Report:
    recording = Recording(path)
    return verify(recording, change_plan(recording, sets), tolerance=tolerance)


def play(path: Path, out: Path, *sets: str, **more) -> Replay:
    recording = Recording(path)
    replay = Replay(recording, change_plan(recording, sets, more.pop("graph", None)), out=out, **more)
    replay.run()
    return replay


def streams(path: Path) -> dict[str, list[bytes]]:
    payloads: dict[str, list[bytes]] = {}
    for name, _, _, payload in Recording(path).raw():
        payloads.setdefault(name, []).append(payload)
    return payloads


@pytest.fixture(scope="module")
def touch(tmp_path_factory) -> Path:
    return record(tmp_path_factory.mktemp("touch"))


@pytest.fixture(scope="module")
def live(tmp_path_factory) -> Path:
    """A live run with everything that can go wrong on the way."""
    return record_live(tmp_path_factory.mktemp("live"), 500, place=None)


@pytest.fixture(scope="module")
def kidney(tmp_path_factory) -> Path:
    """The golden touch of the shipped loop."""
    return HERE / "golden" / "plane.mcap"


# -- check ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [GRAPH, BAD_DAY], ids=["plain", "divisors"])
@pytest.mark.parametrize("place", ["fused", None])
def test_a_simulated_run_is_reproduced_bit_for_bit(tmp_path, place, text):
    report = check(record(tmp_path, text, place=place))
    assert report.ok and report.complete
    assert set(report.nodes) == set(NODES)
    assert report.nodes["sum"].checked >= 66


def test_a_live_run_with_late_held_and_lost_messages_is_reproduced_bit_for_bit(live):
    recording = Recording(live)
    used = [(m.tick, tick) for name in ("spread", "sum") for m in recording.messages(name) for tick in m.used]
    assert any(tick != own for own, tick in used), "no message was held: not the run that this test needs"
    assert len({len(list(recording.messages(name))) for name in NODES}) > 1, "no tick was left out"
    report = check(live)
    assert report.ok and report.complete, report.first


def without(path: Path, *lost: tuple[str, int], wrong: tuple[str, int] | None = None) -> Path:
    """A recording that has lost these messages on their way, by stream and tick, and in which one is another."""
    stored, target = Stored(path), path.with_name("lossy.mcap")
    with open(target, "wb") as file:
        writer, channels = begin_copy(stored, file, stored.about)
        for name, tick, time, payload in stored.raw():
            if (name, tick) == wrong:
                payload = pack(msgspec.structs.replace(unpack(payload, stored.streams[name].type), source="x"))
            if (name, tick) not in lost:
                writer.add_message(channels[name], tick, time, payload)
        missing = [name for name, _ in lost]
        counts = {name: {**own, "lost": missing.count(name)} for name, own in stored.counts.items()}
        write_json(writer, "palpate.counts", counts)
        writer.finish()
    return target


@pytest.mark.parametrize("tick", [0, 57, 199])
def test_a_check_of_a_recording_with_losses_checks_the_rest_and_names_the_gap(tmp_path, tick):
    """Here no node has a state, so all that is in the file agrees; what used the lost message cannot be computed."""
    path = without(record(tmp_path), ("spring", tick))
    report = check(path)
    assert report.ok and not report.complete and not any(node.stopped for node in report.nodes.values())
    checked = {name: node.checked for name, node in report.nodes.items()}
    last = tick == 199
    assert checked == {"source": 200, "spring": 199, "drag": 199, "spread": 199, "sum": 200}
    assert report.nodes["spring"].gap == (
        f"from tick {tick} on: the recording lost 1 messages of stream 'spring', so the node's steps are not all known"
    ) or (last and not report.nodes["spring"].gap)
    assert f"from tick {tick} on: " in report.nodes["drag"].gap and "is not in the file" in report.nodes["drag"].gap
    code, out, _ = say("replay", "--check", path)
    assert code == 1 and "no message could be checked" not in out
    whole = f"verified: 0 to {tick / 1000 - 0.001:.3f} s" if tick else "nothing was verified as a whole"
    assert f"not the whole run: {whole}" in out
    assert "checked but for a gap: drag: from tick" in out


def test_before_a_gap_a_change_is_a_difference_and_after_it_unknown(tmp_path):
    path = record(tmp_path)
    before = check(without(path, ("drag", 100), wrong=("drag", 50)))
    assert not before.ok and before.first.tick == 50
    after = check(without(path, ("drag", 100), wrong=("drag", 150)))
    assert (
        after.ok and after.nodes["drag"].checked == 149 and after.nodes["drag"].stopped.startswith("from tick 100 on")
    )


def test_an_incomplete_recording_is_not_a_successful_run(tmp_path):
    path = record(tmp_path)
    assert lacking(path) == ""
    lossy = without(path, ("drag", 100), ("drag", 101), ("sum", 7))
    assert lacking(lossy) == f"recording {lossy} lacks messages that did not reach it in time: drag 2, sum 1"
    for lost, ok in ((path, True), (lossy, False)):
        outcome = RunOutcome(None, Result(ticks=200), lost)
        assert outcome.ok is ok and bool(outcome.lacking) is not ok
    cut = path.with_name("cut.mcap")
    cut.write_bytes(path.read_bytes()[:-20])
    assert "is not complete" in lacking(cut) and "is not complete" in lacking(tmp_path / "none.mcap")


@pytest.mark.parametrize("whole", [True, False])
def test_a_touch_with_missing_messages_in_its_recording_reports_them_and_exits_1(tmp_path, monkeypatch, whole):
    made = record(tmp_path)
    if not whole:
        made = without(made, ("drag", 100))

    def touched(launch, graph, watch):
        launch.record.parent.mkdir(exist_ok=True)
        shutil.copy(made, launch.record)
        return RunOutcome(None, Result(ticks=200), launch.record)

    def show(session, *_):
        session.stopping.set()
        session._one_run()
        session._pointers.close()
        session.place.cleanup()

    monkeypatch.setattr("palpate.views.page.session.execute", touched)
    monkeypatch.setattr("palpate.views.page.session.Session.open", lambda _: None)
    monkeypatch.setattr("palpate.cli.commands.running.touch.show", show)
    code, out, err = say("touch", "kidney", "--out", tmp_path / "touched", "--no-open")
    assert code == (0 if whole else 1), err
    assert "kidney-1.mcap" in out
    assert ("lacks messages that did not reach it in time: drag 1" in err) is not whole


def test_a_live_run_in_groups_is_reproduced_bit_for_bit(tmp_path):
    place = write_place(tmp_path, [["source", "sum"], ["drag", "spring"], ["spread"]])
    report = check(record_live(tmp_path, 200, place=place))
    assert report.ok and report.complete, report.first


def test_a_live_run_with_the_logger_in_a_process_of_nodes_is_reproduced(tmp_path):
    """Its node's messages come to it by another way than the word that the node has begun."""
    place = write_place(tmp_path, [["source"], ["spring", "drag"], ["spread"], ["sum", "log"]])
    path = record_live(tmp_path, 500, place=place)
    recording = Recording(path)
    assert not recording.restarted
    assert check(path).ok


def test_inputs_absent_after_a_death_are_absent_in_the_check(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: kill, at: 100,")
    path = tmp_path / "run.mcap"
    execute(LaunchFile(graph=write_graph(tmp_path, text), duration=60.0, record=path, clock="real"))
    recording = Recording(path)
    ends = [m.used for m in recording.messages("source")]
    assert (-1,) in ends[10:], "the source never lost its torque"
    # The killed node would kill this process at its hundredth step: it is left alone, the others are checked.
    report = verify(recording, change_plan(recording, ["spring.at=0"]))
    assert report.nodes["source"].differing == 0 and report.nodes["source"].checked > 100


@pytest.mark.parametrize(("source", "at"), [("nodes_for_runs.Source", 300), ("nodes_for_recording.Behind", 100)])
def test_a_restarted_node_is_restarted_in_the_check(tmp_path, source, at):
    """The first message that reaches the new one may be of a tick from before it began: that one it does not answer."""
    node = f"nodes_for_recording.Counting, at: {at}, note: {tmp_path}/killed, restart: true,"
    text, path = GRAPH.replace("nodes_for_runs.Drag,", node), tmp_path / "run.mcap"
    graph = write_graph(tmp_path, text.replace("nodes_for_runs.Source", source))
    execute(LaunchFile(graph=graph, duration=60.0, record=path, clock="real"), watch=until_it_is_back("drag"))
    recording = Recording(path)
    (begun,) = recording.restarted["drag"]
    ticks = [m.tick for m in recording.messages("drag")]
    assert begun > 0 and max(ticks) > begun
    report = verify(recording, change_plan(recording, ["drag.at=0"]))
    assert report.nodes["drag"].differing == 0 and report.nodes["drag"].checked > at


def tampered(path: Path, target: Path, stream: str, tick: int, **fields) -> Path:
    """A copy of a recording with one message changed."""
    recording = Recording(path)
    with open(target, "wb") as file:
        writer = Writer(file)
        writer.start(profile="palpate")
        writer.add_metadata("palpate.about", {k: json.dumps(v) for k, v in recording.about.items()})
        channels = {}
        for name, its in recording.streams.items():
            schema = writer.register_schema(its.schema["title"], "jsonschema", json.dumps(its.schema).encode())
            printed = {"producer": its.producer, "every": str(its.every), "thin": "1"}
            channels[name] = writer.register_channel(name, "msgpack", schema, printed)
        for name, at, time, payload in recording.raw():
            if (name, at) == (stream, tick):
                payload = pack(msgspec.structs.replace(unpack(payload, recording.streams[name].type), **fields))
            writer.add_message(channels[name], time, payload, time, at)
        writer.finish()
    return target


def test_the_first_difference_is_reported_with_stream_tick_field_and_both_values(touch, tmp_path):
    path = tampered(touch, tmp_path / "t.mcap", "drag", 77, bristle=(0.0, 0.25, 0.0))
    report = check(path)
    first = report.first
    assert (first.stream, first.tick, first.field, first.unit) == ("drag", 77, "bristle[1]", "m")
    assert report.until == 0.076  # [s] of the last tick before
    assert (first.recorded, first.computed) == ("0.25", "0.0")
    code, out, _ = say("replay", path, "--check")
    assert code == 1 and "stream 'drag', tick 77, field bristle[1] [m]: recorded 0.25, computed 0.0" in out
    code, out, _ = say("replay", path, "--check", "--json")
    data = json.loads(out)
    assert code == 1 and not data["ok"] and data["first"]["tick"] == 77
    assert data["nodes"]["spring"]["differing"] == 0


@pytest.mark.parametrize("tolerance", [0.0, 1e-6])
def test_a_difference_in_the_header_alone_is_reported(touch, tmp_path, tolerance):
    path = tampered(touch, tmp_path / "t.mcap", "spread", 77, source="drag")
    first = check(path, tolerance=tolerance).first
    assert (first.stream, first.tick, first.field) == ("spread", 77, "source")
    assert (first.recorded, first.computed) == ("'drag'", "'spread'")


def test_a_changed_input_is_first_reported_at_its_stream(touch, tmp_path):
    """The force of one tick is falsified: the sender differs there, and the readers at the same tick after it."""
    path = tampered(touch, tmp_path / "t.mcap", "spring", 50, force=(1.0, 0.0, 0.0))
    report = check(path)
    assert (report.first.stream, report.first.tick) == ("spring", 50)
    assert report.nodes["spring"].differing == 1
    assert report.nodes["drag"].first.tick == report.nodes["spread"].first.tick == 50
    assert report.nodes["source"].differing == 0


def test_the_smallest_change_of_a_number_is_found_and_within_a_tolerance_accepted(touch, tmp_path):
    value = list(Recording(touch).messages("spring"))[60].force[0]
    path = tampered(touch, tmp_path / "t.mcap", "spring", 60, force=(value * (1 + 3e-16), 0.0, 0.0))
    assert check(path).first.tick == 60
    assert check(path, tolerance=1e-12).ok
    assert not check(path, tolerance=1e-17).ok
    assert check(path).nodes["spring"].largest < 1e-15


def test_a_negative_zero_is_a_difference(touch, tmp_path):
    value = list(Recording(touch).messages("spring"))[60].force[0]
    path = tampered(touch, tmp_path / "t.mcap", "spring", 60, force=(value, -0.0, 0.0))
    assert check(path).first.field == "force[1]"


def test_the_check_finds_a_changed_setting(touch):
    code, out, _ = say("replay", touch, "--check", "--set", "spring.stiffness=5.1")
    assert (code == 1 and "stream 'spring', tick 0, field force[0] [N]: recorded -5.0" in out) or "recorded -4.9" in out


def test_a_recording_with_streams_left_out_is_checked_on_the_other_streams(tmp_path):
    path = tmp_path / "run.mcap"
    launch = LaunchFile(graph=write_graph(tmp_path), duration=0.1, record=path, place="fused")
    execute(launch, leave_out=["spring"], thin={"sum": 4})
    code, out, _ = say("replay", path, "--check")
    assert code == 1 and "not the whole run: nothing was verified as a whole" in out
    assert "not checked: spring: stream 'spring' was left out" in out
    assert "not checked: drag: stream 'spring', which it reads, was left out" in out
    assert "not checked: sum: stream 'sum' was thinned out" in out
    code, out, _ = say("replay", path, "--check", "--json")
    assert not json.loads(out)["complete"]


def test_the_shipped_loop_is_reproduced_bit_for_bit_after_a_live_run(tmp_path):
    launch = LaunchFile(graph=HERE / "golden" / "plane.yaml", duration=0.8, record=tmp_path / "a.mcap", clock="real")
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    report = check(tmp_path / "a.mcap")
    assert report.ok and report.complete, report.first
    replay = play(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert sum(r.checked for r in replay.reports.values()) > 0
    assert not any(r.differing for r in replay.reports.values())


def test_a_node_that_begins_late_or_again_begins_without_force_in_a_replay_too():
    """On a loaded machine a controller began 74 ms after the run, so that its force rose from zero; the replay computed
    a thousand times the recorded force."""
    recording = Recording(HERE / "golden" / "plane.mcap")
    recording.late, recording.restarted = {"controller": 9}, {"contact": [3], "controller": [50]}
    plan = plan_of(recording)
    player = Player(recording, plan, plan.order, live=True)
    controller = next(part for part in player.parts if part.name == "controller")
    began = []
    controller.node.replaces = lambda: began.append(player.at)
    player.start()
    assert len(began) == 1
    for tick, payloads in recording.instants(recording.ticks()):
        if tick == 60:
            break
        player.step(tick, payloads)
    player.stop()
    assert len(began) == 2 and 40_000_000 < began[1] < 60_000_000


# -- replay --------------------------------------------------------------------------------------------------------


def test_the_recorded_source_drives_the_graph_to_the_same_bytes(touch, tmp_path):
    replay = play(touch, tmp_path / "again.mcap")
    assert streams(tmp_path / "again.mcap") == streams(touch)
    assert set(replay.reports) == set(NODES) - {"source"}
    assert Recording(tmp_path / "again.mcap").about["replay_of"] == str(touch)


def test_a_live_run_replays_to_the_same_bytes_whole_and_in_any_part(live, tmp_path):
    recorded = streams(live)
    for only in (None, ["drag"], ["spring", "spread"], ["sum", "source"], list(NODES)):
        out = tmp_path / f"{len(only or ())}-{(only or ['all'])[0]}.mcap"
        replay = play(live, out, only=only)
        assert not any(r.differing for r in replay.reports.values()), only
        assert streams(out) == recorded


def test_a_replay_can_be_replayed_and_checked(live, tmp_path):
    play(live, tmp_path / "a.mcap")
    assert check(tmp_path / "a.mcap").ok


def test_another_setting_changes_only_the_dependent_streams(touch, tmp_path):
    """The hand is played, so the others see the poses of the recording: spring and drag are closed forms of them."""
    play(touch, tmp_path / "a.mcap", "spring.stiffness=9")
    new = Recording(tmp_path / "a.mcap")
    for pose, force, drag in zip(*(new.messages(n) for n in ("source", "spring", "drag")), strict=True):
        assert force.force[0] == -9.0 * pose.position[0]
        assert drag.force[0] == 0.1 * pose.velocity[0] * force.force[0]
    assert new.about["plan"]["nodes"][1]["settings"]["stiffness"] == 9


def test_replaying_one_node_with_another_setting_keeps_the_others_as_recorded(touch, tmp_path):
    play(touch, tmp_path / "a.mcap", "spring.stiffness=9", only=["spring"])
    before, after = streams(touch), streams(tmp_path / "a.mcap")
    assert {name for name in NODES if before[name] != after[name]} == {"spring"}


def test_another_graph_is_driven_by_the_recorded_source(touch, tmp_path):
    graph = tmp_path / "other.yaml"
    graph.write_text(
        "nodes:\n"
        "  hand: {use: nodes_for_runs.Source, in: {torque: motor}}\n"
        "  stiff: {use: nodes_for_runs.Spring, in: {pose: hand}, stiffness: 7, every: 2}\n"
        "  load: {use: nodes_for_runs.Spread, in: {force: stiff}}\n"
        "  motor: {use: nodes_for_runs.Sum, in: {load: load}}\n"
    )
    recording = Recording(touch)
    # `palpate` finds the recorded stream by its type: Pose, sent by `source` then, by `hand` now.
    poses = [m.position for m in recording.messages("source")]
    play(touch, tmp_path / "a.mcap", graph=str(graph))
    new = Recording(tmp_path / "a.mcap")
    assert [m.position for m in new.messages("hand")] == poses
    forces = {m.tick: m.force[0] for m in new.messages("stiff")}
    assert forces == {tick: -7 * poses[tick][0] for tick in range(0, 200, 2)}
    loads = list(new.messages("load"))
    assert [m.used[0] for m in loads] == [tick - tick % 2 for tick in range(200)], "held, as simulated time does"


def test_a_graph_whose_source_is_not_in_the_recording_is_an_error(touch, tmp_path):
    code, _, err = say("replay", touch, "--graph", "kidney")
    assert code == 2 and "sends DeviceState; streams of that type in the recording: none" in err
    assert len(err.strip().splitlines()) == 1


def test_an_effect_that_the_run_did_not_have_can_be_switched_on(kidney, tmp_path):
    smooth = HERE / "golden" / "smooth.mcap"
    play(smooth, tmp_path / "a.mcap", "scene.tissue.friction=on")
    rough = Recording(tmp_path / "a.mcap")
    assert max(abs(m.force[0]) for m in rough.messages("friction")) > 0.01
    assert len(list(rough.messages("friction"))) == 120


def test_from_and_to_replay_a_part_with_its_recorded_state(touch, tmp_path):
    play(touch, tmp_path / "a.mcap", begin=0.05, end=0.1)
    part, whole = streams(tmp_path / "a.mcap"), streams(touch)
    assert all(part[name] == whole[name][50:101] for name in NODES)


def test_a_replay_has_the_speed_of_the_option(touch):
    recording = Recording(touch)
    replay = Replay(recording, plan_of(recording), speed=2.0)
    replay.run()
    assert replay.wall >= 0.199 / 2.0


def test_a_replay_does_not_overwrite_its_input(touch):
    code, _, err = say("replay", touch, "--record", touch)
    assert code == 2 and "name another" in err


def test_a_left_out_stream_is_an_error_with_the_cure(tmp_path):
    path = tmp_path / "run.mcap"
    execute(LaunchFile(graph=write_graph(tmp_path), duration=0.05, record=path, place="fused"), leave_out=["spring"])
    code, _, err = say("replay", path, "--only", "drag")
    assert code == 2 and "'drag' reads the stream 'spring', which was left out" in err and "--only ... spring" in err
    assert say("replay", path)[0] == 0
    execute(LaunchFile(graph=write_graph(tmp_path), duration=0.05, record=path, place="fused"), leave_out=["source"])
    code, _, err = say("replay", path)
    assert code == 2 and "'source', which drives the graph, was left out" in err


def test_a_class_that_no_longer_fits_is_an_error_of_one_line(touch, tmp_path):
    def rewritten(edit) -> Path:
        recording = Recording(touch)
        edit(recording.about["plan"]["nodes"])
        target = tmp_path / "edited.mcap"
        with open(target, "wb") as file:
            writer = Writer(file)
            writer.start(profile="palpate")
            writer.add_metadata("palpate.about", {k: json.dumps(v) for k, v in recording.about.items()})
            for name, its in recording.streams.items():
                schema = writer.register_schema(its.schema["title"], "jsonschema", json.dumps(its.schema).encode())
                writer.register_channel(name, "msgpack", schema, {"producer": its.producer, "every": "1"})
            writer.finish()
        return target

    def gone(nodes):
        nodes[1]["class"] = "nodes_for_runs.Gone"

    def setting(nodes):
        nodes[1]["settings"]["hardness"] = 3

    for edit, words in ((gone, "'nodes_for_runs.Gone' cannot be imported"), (setting, "'hardness': unknown")):
        for verb in (["replay", "{}", "--check"], ["replay", "{}"]):
            path = rewritten(edit)
            code, _, err = say(*(path if a == "{}" else a for a in verb))
            assert code == 2 and words in err and "Traceback" not in err
            assert len(err.strip().splitlines()) == 1
        assert say("info", path)[0] == 0


def test_wrong_options_are_errors(touch):
    for args in (["--speed", "0"], ["--from", "2", "--to", "1"], ["--check", "--only", "sum"]):
        assert say("replay", touch, *args)[0] == 2
    code, _, err = say("replay", touch, "--only", "sprong")
    assert code == 2 and "no running node 'sprong'" in err


def test_the_device_of_a_recording_is_a_node_like_any_other(kidney, tmp_path):
    """device.Replayed in a custom graph: the same states, one per tick, fused and with one process per node."""
    recorded = [m.joints for m in Recording(kidney).messages("device")]
    graph = tmp_path / "mine.yaml"
    graph.write_text(
        f"nodes:\n  device: {{use: device.Replayed, path: {kidney}}}\n"
        "  finger: {use: kinematics.FalconKinematics, in: {state: device}}\n"
    )
    runs = []
    for place in ("fused", None):
        path = tmp_path / f"{place}.mcap"
        outcome = execute(LaunchFile(graph=graph, duration=0.2, record=path, place=place))
        assert outcome.result.ok, outcome.result.deaths
        runs.append(streams(path))
        joints = [m.joints for m in Recording(path).messages("device")]
        assert joints[:120] == recorded and set(joints[120:]) == {recorded[-1]}
    assert runs[0] == runs[1]


# -- other ticks ----------------------------------------------------------------------------------------------------

STEADY = GRAPH.replace("nodes_for_runs.Source,", "nodes_for_runs.Source, gain: 0,")
"""The motion of its source is independent of the other nodes."""


@pytest.mark.parametrize(("then", "now"), [(1, 3), (3, 1), (2, 6)])
def test_a_node_replayed_at_other_ticks_equals_a_run_with_these_ticks(tmp_path, then, now):
    spread = "spread: {use: nodes_for_runs.Spread,"
    runs = []
    for every in (then, now):
        folder = tmp_path / f"every{every}"
        folder.mkdir()
        runs.append(record(folder, STEADY.replace(spread, f"{spread} every: {every},"), ticks=60))
    play(runs[0], tmp_path / "a.mcap", f"spread.every={now}")
    assert streams(tmp_path / "a.mcap") == streams(runs[1])
    assert check(tmp_path / "a.mcap").ok


def test_every_of_a_live_run_is_applied_in_simulated_time(live, tmp_path):
    """What the others have used, late and held, stays as recorded."""
    played = play(live, tmp_path / "a.mcap", "spread.every=5")
    before, after = streams(live), streams(tmp_path / "a.mcap")
    assert {unpack(m, Load).tick % 5 for m in after["spread"]} == {0}
    assert all(before[name] == after[name] for name in ("source", "spring", "drag")) and before["sum"] != after["sum"]
    assert played.player.substituted == 0


@pytest.mark.parametrize("verb", ["replay", "compare"])
def test_another_rate_and_a_setting_of_a_played_stream_are_errors(touch, verb):
    code, _, err = say(verb, touch, "--set", "rate=500")
    assert code == 2 and "recorded at 1000 Hz" in err and "found rate=500, expected 1000" in err
    code, _, err = say(verb, touch, "--set", "source.gain=0.1")
    assert code == 2 and "source.gain: 'source' is played from the recording, so this has no effect" in err


def test_compare_honours_every(kidney):
    (variant,) = compare(Recording(kidney), [["tissue.every=10"]], reference=[])[1:]
    assert variant.swapped == ("tissue",) and 1 <= variant.step.count <= 12  # a third of the steps are measured
    assert variant.shape.peak > 0.0 and variant.force.peak > 0.0


def test_settings_without_an_override_are_as_recorded_also_if_the_default_changed(kidney):
    """The golden friction was recorded with `rescale` off, which is on by default since."""
    recording = Recording(kidney)
    assert change_plan(recording, ["tissue.every=10"]).graph.nodes["friction"].settings["rescale"] is False
    (variant,) = compare(recording, [["friction.rescale=true"]], reference=[])[1:]
    assert variant.swapped == ("friction",) and variant.plan.graph.nodes["friction"].settings["rescale"] is True


def test_a_check_at_other_ticks_is_refused(touch):
    code, _, err = say("replay", touch, "--check", "--set", "spread.every=2")
    assert code == 2 and "a check steps every node at its recorded ticks" in err
    code, _, err = say("replay", touch, "--only", "spring", "--set", "drag.every=2")
    assert code == 2 and "drag.every: 'drag' is played" in err


# -- compare -------------------------------------------------------------------------------------------------------


def test_a_variant_equal_to_the_recorded_model_has_no_difference(kidney):
    first, second = compare(Recording(kidney), [[], ["tissue.use=deformation.MassSpring"]])
    for spread in (second.force, second.indentation, second.shape):
        assert spread.peak == 0.0 and spread.count > 0
    assert first.force.scale > 0.05


def test_differences_are_listed_for_the_replayed_streams(kidney, tmp_path):
    """RMS and peak by hand from a recorded replay of the variant."""
    import numpy as np

    play(kidney, tmp_path / "a.mcap", "tissue.stiffness=1e3")
    old, new = (Recording(p).columns("controller")["force"] for p in (kidney, tmp_path / "a.mcap"))
    apart = np.linalg.norm(old - new, axis=1)
    _, variant = compare(Recording(kidney), [["tissue.stiffness=1e3"]], reference=[])
    assert variant.force.report()["rms"] == pytest.approx(np.sqrt((apart**2).mean()), rel=1e-12)
    assert variant.force.peak == pytest.approx(apart.max(), rel=1e-12)
    assert variant.swapped == ("tissue",)
    assert 20 < variant.step.count < 40, "a third of its steps is measured, and it sleeps before the touch"


def test_compare_prints_a_table_and_draws_a_picture(kidney, tmp_path):
    picture = tmp_path / "c.png"
    args = ["compare", kidney, "--set", "tissue.use=deformation.MassSpring", "--set", "tissue.use=deformation.Rigid"]
    code, out, err = say(*args, "--variant", "tissue.stiffness=2e3 tissue.damping=0", "-o", picture)
    assert code == 0, err
    assert "deformation.Rigid, changes tissue" in out and picture.read_bytes()[:4] == b"\x89PNG"
    code, out, _ = say(*args, "--no-pictures", "--json")
    data = json.loads(out)
    assert code == 0 and [len(v["set"]) for v in data["variants"]] == [1, 1]
    assert data["variants"][1]["force_N"]["rms"] > 0 and data["variants"][1]["step_s"]["p50"] > 0
    code, _, err = say("compare", kidney, "--set", "tissue.stifness=3")
    assert code == 2 and "stiffness" in err


def test_compare_without_a_variant_is_an_error(kidney):
    assert say("compare", kidney)[0] == 2
    with pytest.raises(RecordingError, match="two variants"):
        compare(Recording(kidney), [[]])


@pytest.mark.parametrize(("graph", "change"), [("kidney", "tissue.every=2"), ("palpate-two", "tissue.every=2")])
def test_one_call_for_each_tick_gives_the_results_of_single_steps(tmp_path, monkeypatch, graph, change):
    file = palpate.run(graph, record=tmp_path / "a.mcap", duration=0.5).path
    recording, found = Recording(file), []
    for kind in (SegmentPlayer, Player):
        if kind is Player:
            monkeypatch.setattr(segment_player, "_follows_simulated_time", lambda *given: False)
        players, stepped = [], []

        def on_tick(given, players=players, stepped=stepped):
            players[:] = given
            stepped.append([pack(one) for player in given for part in player.parts for one in player.last(part.name)])

        variants = compare(recording, [[change]], reference=[], on_tick=on_tick)
        assert {type(player) for player in players} == {kind}
        results = [{k: v for k, v in one.report().items() if not k.endswith("_s")} for one in variants]
        found.append([results, [one.curves for one in variants], stepped])
    assert found[0] == found[1] and found[0][0][1]["force_N"]["peak"] > 0.0


def test_only_recordings_of_simulated_time_without_gaps_are_computed_in_one_call(kidney):
    def kind(recording, present):
        plan = change_plan(recording)
        running = [name for name in plan.order if name not in sources(recording, plan)]
        return type(live_player(recording, plan, running, present))

    live, whole = Recording(HERE / "golden" / "live.mcap"), Recording(kidney)
    assert kind(live, live.ticks()) is Player and kind(whole, whole.ticks()) is SegmentPlayer
    ended = {**whole.ticks(), "tissue": whole.ticks()["tissue"][:-3]}  # as of a node that has died
    assert kind(whole, ended) is Player
    gap = {**whole.ticks(), "tissue": whole.ticks()["tissue"][[0, 1, *range(5, len(whole.ticks()["tissue"]))]]}
    assert kind(whole, gap) is Player
