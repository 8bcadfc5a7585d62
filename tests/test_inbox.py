"""Messages that are written straight to the reader's inbox, and those that have to go another way."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zmq
from graphs_for_runs import GRAPH, write_graph
from nodes_for_runs import Spring

from palpate.launch.loading.launchfile import LaunchFile
from palpate.launch.recording.reader import Recording
from palpate.launch.running.bus import Bus, frame, order
from palpate.launch.running.execute import execute
from palpate.launch.running.inbox import LARGEST, pair, post
from palpate.launch.running.job import InputJob, Job, NodeJob, ObserverJob
from palpate.launch.running.links import inboxes
from palpate.launch.running.slot import Input
from palpate.launch.running.worker import Worker
from palpate.messages import Pose
from palpate.nodes.base import inputs

AHEAD = """
wanted: [spring]
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Faulty, in: {pose: source}, how: doze}
  log:    {use: logger.Mcap, in: all}
"""


@pytest.fixture
def control() -> Iterator[zmq.Socket]:
    """A launcher's socket for orders."""
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.set(zmq.LINGER, 0)
        socket.bind("ipc://@palpate-test-inbox")
        yield socket


@pytest.fixture
def bus(control) -> Iterator[Bus]:
    """The sockets of a worker `b`."""
    ends = pair()
    found = Bus("test", "b", "ipc://@palpate-test-inbox", "ipc://@palpate-test-reports", True, {"b": ends})
    for _ in range(2):
        control.recv()  # it has subscribed
    yield found
    found.context.destroy(linger=0)


def read(bus: Bus) -> bytes:
    """The next frame; a receive may give up before."""
    return next(filter(None, (bus.receive(block=True) for _ in range(100))))


def test_frames_come_whole_and_in_order(bus):
    sent = [frame("pose", bytes([i]) * size) for i, size in enumerate((1, 200, LARGEST - 5, 0, 3000))]
    for data in sent:
        assert post(bus.boxes(("b",)), data)
    assert bus.waiting()
    assert [read(bus) for _ in sent] == sent
    assert bus.receive(block=False) is None


def test_what_was_sent_to_a_predecessor_is_thrown_away(bus, control):
    boxes = bus.boxes(["b"])
    post(boxes, frame("pose", b"while it was down"))
    control.send(frame("~b", b'{"do": "connect"}'))
    assert bus.orders() == {"do": "connect"}
    post(boxes, frame("pose", b"before it has connected"))
    bus.forget()
    post(boxes, frame("pose", b"new"))
    control.send(frame("~b", b'{"do": "go"}'))
    assert bus.orders() == {"do": "go"}
    bus.release()
    assert read(bus) == frame("pose", b"new")


def test_a_full_inbox_takes_nothing_and_loses_nothing(bus):
    boxes = bus.boxes(["b"])
    sent = 0
    while post(boxes, frame("pose", b"%d" % sent)):
        sent += 1
    assert sent > 100
    assert [read(bus) for _ in range(sent)] == [frame("pose", b"%d" % i) for i in range(sent)]
    assert post(boxes, frame("pose", b"again"))


def test_an_order_of_the_launcher_does_not_wait_behind_the_messages(bus, control):
    while post(bus.boxes(["b"]), frame("pose", b"0")):
        pass
    control.send(frame("~*", b'{"do": "stop"}'))
    assert bus.subscriber.poll(5000)
    heard = [read(bus) for _ in range(3)]
    assert {"do": "stop"} in [order(data) for data in heard if data[:1] == b"~"]


def test_where_one_reader_has_no_inbox_the_stream_goes_through_zeromq(bus):
    assert bus.boxes(["b", "far"]) == ()


def test_a_stream_that_found_an_inbox_full_uses_inboxes_again_when_a_node_has_come_back(bus, control):
    node = NodeJob("source", "nodes_for_runs.Source", {}, 1, (), ("source",))
    worker = Worker(Job(group="a", nodes=(node,), external={"source": ("b",)}), bus, lambda _: None)
    (output,) = worker.slots[0].outputs
    while output.post(frame("source", b"0")):
        pass
    bus.forget()
    assert not output.post(frame("source", b"0"))
    control.send(frame("~*", b'{"do": "alive", "nodes": ["reader"], "mute": []}'))
    while not output.boxes:
        worker.receive(block=True)
    assert output.post(frame("source", b"0"))


def test_those_on_other_machines_and_those_with_observers_have_no_inbox():
    def job(name: str, **more) -> Job:
        return Job(group=name, nodes=(NodeJob(name, "", {}, 1, (), (name,)),), **more)

    log = ObserverJob("log", "", {}, {})
    sender = job("a", external={"a": ("b", "far"), "a2": ("b", "watched")})
    jobs = {j.group: j for j in (sender, job("b"), job("far"), job("watched", observers=(log,)))}
    assert inboxes(jobs, {"far"}) == ["b"]


def pose(tick: int) -> Pose:
    return Pose(position=(0, 0, 0), velocity=(0, 0, 0), dt=1e-3, tick=tick)


def port() -> Input:
    return Input(InputJob("pose", "source", "source"), inputs(Spring)[0], None)


def test_messages_that_overtake_or_come_twice_are_sorted_by_tick():
    simulated, real = port(), port()
    for tick in (0, 2, 3, 1, 2, 4, 4):
        simulated.put(pose(tick), 0)
        real.put(pose(tick), 0)
    assert [m.tick for m in simulated.queue] == [0, 1, 2, 3, 4]
    assert [simulated.at(tick).tick for tick in range(5)] == [0, 1, 2, 3, 4]
    assert real.newest(3).tick == 3
    real.put(pose(3), 0)  # again, after it was used
    assert [m.tick for m in real.queue] == [4]


def recorded(folder, name: str, text: str, ticks: int, place: str | None) -> list[tuple[str, bytes]]:
    """Stream and payload of all messages of a run, by stream and tick."""
    file = folder / f"{name}.mcap"
    outcome = execute(LaunchFile(graph=write_graph(folder, text), place=place, duration=ticks / 1000, record=file))
    assert outcome.result.ok, outcome.result.deaths
    return sorted((stream, tick, payload) for stream, tick, payload in Recording(file).payloads())


def test_messages_too_large_for_an_inbox_arrive_among_the_others(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spread,", "nodes_for_runs.Swell,")
    alone, processes = (recorded(tmp_path, str(place), text, 200, place) for place in ("fused", None))
    assert max(len(payload) for _, _, payload in processes) > LARGEST
    assert processes == alone


def test_a_sender_far_ahead_of_its_reader_loses_nothing(tmp_path):
    alone, processes = (recorded(tmp_path, str(place), AHEAD, 6000, place) for place in ("fused", None))
    assert len(processes) == 12_000 and processes == alone


def test_a_reader_that_dies_with_a_full_inbox_ends_the_run(tmp_path):
    graph = write_graph(tmp_path, AHEAD.replace("doze", "doze and die"))
    outcome = execute(LaunchFile(graph=graph, duration=5000.0))
    assert [death.node for death in outcome.result.deaths] == ["spring"]


def test_a_reader_that_has_ended_does_not_hold_up_its_sender(tmp_path):
    """It has no step after tick 0 and nothing to wait for."""
    graph = write_graph(tmp_path, AHEAD.replace("how: doze", "every: 30000"))
    outcome = execute(LaunchFile(graph=graph, duration=20.0))
    assert outcome.result.ok and outcome.result.health["source"]["tick"] == 19_999
