"""The two carriers between processes: frames whole and in order, senders held back, the same bytes on both."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
import zmq
from graphs_for_runs import GRAPH, write_graph
from nodes_for_runs import Spring

from palpate.launch.loading.graph import GraphError
from palpate.launch.loading.launchfile import LaunchFile
from palpate.launch.loading.placement import load_place
from palpate.launch.recording.reader import Recording
from palpate.launch.running.carrier import PART, LocalInlet, LocalOutlet, ZmqInlet, ZmqOutlet, pair
from palpate.launch.running.execute import execute
from palpate.launch.running.job import InputJob, Job, NodeJob
from palpate.launch.running.slot import Input
from palpate.launch.running.wires import pairs
from palpate.messages import Pose
from palpate.nodes.base import inputs

AHEAD = """
wanted: [spring]
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Faulty, in: {pose: source}, how: doze}
  log:    {use: logger.Mcap, in: all}
"""
SIZES = (1, 200, 0, 3000, PART - 1, PART, PART + 1, 3 * PART, 300_000, 5)


class Wire:
    """A sender and a reader of one stream; `held` counts how often the sender looked round while it was held back."""

    def __init__(self, carrier: str, real: bool) -> None:
        self.held = 0
        if carrier == "local":
            read, write = pair()
            self.inlet = LocalInlet(read, 20, exact=real)
            self.out = LocalOutlet([write], None if real else self.hold)
            self.send, self.context = self.out.send, None
            return
        self.context = zmq.Context()
        out, heard = self.context.socket(zmq.XPUB), self.context.socket(zmq.SUB)
        out.set(zmq.SNDHWM, 100)
        if not real:
            out.set(zmq.XPUB_NODROP, 1)
            out.set(zmq.SNDTIMEO, 20)
        self.inlet = ZmqInlet(heard, "pose", 20)
        heard.set(zmq.RCVHWM, 100)
        out.bind("inproc://wire")
        heard.connect("inproc://wire")
        assert out.poll(1000) and out.recv() == b"\1pose\0"
        self.out = ZmqOutlet(out, self.hold)
        self.send = lambda payload: self.out.send(b"pose\0" + payload)

    def hold(self) -> None:
        self.held += 1
        if self.held > 250:
            raise TimeoutError

    def read(self) -> bytes:
        return next(data for data in (self.inlet.wait() for _ in range(100)) if data is not None)


@pytest.fixture(params=["zmq", "local"])
def carrier(request) -> str:
    return request.param


@pytest.fixture
def wire(carrier) -> Iterator[Wire]:
    ends = Wire(carrier, real=False)
    yield ends
    ends.inlet.close()
    if ends.context is not None:
        ends.context.destroy(linger=0)


def test_frames_of_any_size_come_whole_and_in_order(wire):
    sent = [bytes([i]) * size for i, size in enumerate(SIZES)]
    sender = threading.Thread(target=lambda: [wire.send(data) for data in sent])
    sender.start()
    assert [wire.read() for _ in sent] == sent
    sender.join()
    assert wire.inlet.take() is None


def test_a_full_carrier_holds_its_sender_back_and_loses_nothing(wire):
    count = 3000
    sender = threading.Thread(target=lambda: [wire.send(b"%d" % i + bytes(300)) for i in range(count)])
    sender.start()
    until = time.monotonic() + 10.0
    while not wire.held and time.monotonic() < until:
        time.sleep(0.01)
    assert wire.held and sender.is_alive()
    assert [int(wire.read()[:-300]) for _ in range(count)] == list(range(count))
    sender.join()


def test_a_sender_that_is_held_back_can_be_called_away(wire):
    with pytest.raises(TimeoutError):
        for _ in range(100_000):
            wire.send(bytes(500))


def test_a_reader_that_has_closed_holds_nobody_back(wire):
    wire.inlet.close()
    for _ in range(3000):
        wire.send(bytes(500))
    assert not wire.held


def test_on_the_real_clock_what_has_no_room_is_dropped_whole(carrier):
    wire = Wire(carrier, real=True)
    sent = [b"%6d" % i + bytes([i % 251]) * (100 if i % 3 else 150_000) for i in range(3000)]
    for data in sent:
        wire.send(data)
    heard = []
    while (data := wire.inlet.wait()) is not None:
        heard.append(data)
    assert not wire.held and 10 < len(heard) < len(sent)
    assert heard == [sent[int(data[:6])] for data in heard]
    wire.send(b"after")
    assert wire.read() == b"after"
    if wire.context is not None:
        wire.context.destroy(linger=0)


def test_what_was_sent_to_a_predecessor_is_thrown_away():
    wire = Wire("local", real=True)
    for _ in range(50):
        wire.send(b"while it was down")
    wire.inlet.forget()
    wire.send(b"new")
    assert wire.read() == b"new"


def test_only_what_goes_by_the_local_carrier_gets_pairs():
    def job(name: str, carrier: str) -> Job:
        node = NodeJob(name, "", {}, 1, (), (name,))
        return Job(group=name, nodes=(node,), carrier=carrier, external={name: ("b", "c")})

    assert pairs([job("a", "local"), job("z", "zmq")]) == [("a", "b"), ("a", "c")]


def pose(tick: int) -> Pose:
    return Pose(position=(0, 0, 0), velocity=(0, 0, 0), dt=1e-3, tick=tick)


def test_an_input_drops_a_second_copy_and_what_is_older():
    port = Input(InputJob("pose", "source", "source"), inputs(Spring)[0], None)
    for tick in (0, 2, 2, 1, 4):
        port.put(pose(tick), 0)
    assert [m.tick for m in port.queue] == [0, 2, 4]
    assert port.at(1) is None and port.at(2).tick == 2 and port.newest(3).tick == 2
    port.put(pose(3), 0)
    assert [m.tick for m in port.queue] == [4]


def recorded(folder, text: str, ticks: int, place: str | None, carrier: str | None) -> list[tuple[str, int, bytes]]:
    """Stream, tick and payload of all messages of a run, by stream and tick."""
    file = folder / f"{place}-{carrier}.mcap"
    launch = LaunchFile(graph=write_graph(folder, text), place=place, duration=ticks / 1000, record=file)
    outcome = execute(launch.but(carrier=carrier))
    assert outcome.result.ok, outcome.result.deaths
    return sorted(Recording(file).payloads())


def test_small_and_large_messages_of_one_stream_are_the_same_by_both_carriers(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spread,", "nodes_for_runs.Swell,")
    alone = recorded(tmp_path, text, 200, "fused", None)
    assert max(len(payload) for _, _, payload in alone) > PART
    assert recorded(tmp_path, text, 200, None, "zmq") == alone
    assert recorded(tmp_path, text, 200, None, "local") == alone


def test_a_sender_far_ahead_of_its_reader_loses_nothing(tmp_path, carrier):
    alone = recorded(tmp_path, AHEAD, 6000, "fused", None)
    assert len(alone) == 12_000 and recorded(tmp_path, AHEAD, 6000, None, carrier) == alone


def test_a_reader_that_dies_far_behind_ends_the_run(tmp_path, carrier):
    graph = write_graph(tmp_path, AHEAD.replace("doze", "doze and die"))
    outcome = execute(LaunchFile(graph=graph, duration=5000.0, carrier=carrier))
    assert [death.node for death in outcome.result.deaths] == ["spring"]


def test_a_reader_that_has_ended_does_not_hold_up_its_sender(tmp_path, carrier):
    """It has no step after tick 0 and nothing to wait for."""
    graph = write_graph(tmp_path, AHEAD.replace("how: doze", "every: 30000"))
    outcome = execute(LaunchFile(graph=graph, duration=20.0, carrier=carrier))
    assert outcome.result.ok and outcome.result.health["source"]["tick"] == 19_999


def test_a_reader_that_ends_while_its_sender_is_held_back_lets_it_go():
    """The fork server keeps both ends, so that no end is closed with its reader."""
    read, write = pair()
    inlet = LocalInlet(read, 20, exact=False)
    held = 0

    def hold() -> None:
        nonlocal held
        held += 1
        inlet.close()
        assert held < 3, "the sender still waits for a reader that has ended"

    out = LocalOutlet([write], hold)
    while not held:
        out.send(bytes(1000))
    out.send(b"to nobody")
    assert held == 1


def test_a_slow_branch_beside_a_fast_one_does_not_lock_up(tmp_path, carrier):
    """`sum` waits for `drag` of a far tick while the source's stream, which it reads each tick, fills up."""
    text = """
wanted: [sum]
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Spring, in: {pose: source}, every: 4000}
  sum:    {use: nodes_for_runs.Drag, in: {pose: source, force: spring}, every: 4000}
"""
    graph = write_graph(tmp_path, text)
    outcome = execute(LaunchFile(graph=graph, duration=12.0, carrier=carrier))
    assert outcome.result.ok and outcome.result.health["sum"]["steps"] == 3


def test_the_placement_says_which_group_sends_by_which_carrier(tmp_path):
    place = tmp_path / "place.yaml"
    place.write_text("a: {nodes: [source, sum], carrier: local}\nb: [spring, drag, spread]\n")
    launch = LaunchFile(graph=write_graph(tmp_path))
    groups = load_place(place, launch.plan()).groups
    assert {group.name: group.carrier for group in groups} == {"a": "local", "b": "zmq", "log": "zmq"}
    place.write_text("a: {nodes: [source, sum], carrier: pigeon}\n")
    with pytest.raises(GraphError, match="carrier: found 'pigeon'"):
        load_place(place, launch.plan())


def test_the_local_carrier_does_not_reach_another_machine(tmp_path):
    place = tmp_path / "place.yaml"
    place.write_text("a: {nodes: [source, sum], carrier: local}\nfar: {nodes: [spring, drag, spread], join: true}\n")
    with pytest.raises(GraphError, match="group 'a': carrier local, but group 'far', which reads from it"):
        execute(LaunchFile(graph=write_graph(tmp_path), place=place, duration=0.1), address="tcp://127.0.0.1:5999")
