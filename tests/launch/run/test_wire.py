"""Connections between processes: whole frames in order, blocked senders, and any ZeroMQ program as peer."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq
from graphs_for_runs import GRAPH, write_graph
from nodes_for_runs import Spring

import palpate.messages
from palpate.engine.job import InputJob
from palpate.engine.slot import Input
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.assign import jobs
from palpate.launch.run.execute import execute
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.wire import outlet as outlet_module
from palpate.launch.run.wire.addresses import endpoint
from palpate.launch.run.wire.inlet import CHUNK, Inlet
from palpate.launch.run.wire.outlet import Outlet
from palpate.launch.run.wire.watch import SocketPoller
from palpate.launch.run.wire.zmtp import GREETING, command, frame, pong, ready
from palpate.messages import Force, Message, Pose, pack, unpack
from palpate.nodes.base import inputs
from palpate.records.reader import Recording

AHEAD = """
wanted: [spring]
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Faulty, in: {pose: source}, how: doze}
  log:    {use: logger.Mcap, in: all}
"""
SIZES = (1, 200, 0, 3000, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK, 300_000, 5)


SUB = ready({b"Socket-Type": b"SUB"})
MESSAGES = [
    kind
    for _, kind in sorted(vars(palpate.messages).items())
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
]


class End:
    """One end of a connection, with its poller; `held` counts the polls of a blocked sender."""

    def __init__(self, path: Path, real: bool = False) -> None:
        self.path, self.real, self.held, self.most = str(path), real, 0, 250
        self.watch, self.apart = SocketPoller(), set()

    def hold(self) -> None:
        self.held += 1
        self.watch.poll()
        if self.held > self.most:
            raise TimeoutError

    def listen(self) -> End:
        self.outlet = Outlet("here", {"pose": ("there",)}, self.real, self.watch)
        self.outlet.bind(self.path)
        self.sender = self.outlet.sender("pose", None, self.hold)
        self.send = self.sender.send
        return self

    def read_from(self) -> End:
        self.inlet = Inlet("pose", "there", self.watch, lambda inlet: None, self.apart)
        self.inlet.connect(self.path)
        return self

    def serve(self, until: Callable[[], bool]) -> None:
        """Serve readers until `until` is true."""
        end = time.monotonic() + 60.0
        while not until():
            assert time.monotonic() < end
            self.watch.poll(5)
            self.outlet.tend()

    def next(self) -> bytes:
        """The next payload."""
        if not hasattr(self, "came"):
            self.came: list[bytes] = []
        end = time.monotonic() + 60.0
        while not self.came:
            assert time.monotonic() < end
            for inlet in tuple(self.apart):
                inlet.reach()
            self.came += self.inlet.wait()
        return self.came.pop(0)


def link(writer: End, reader: End) -> None:
    """Complete the connection between both ends."""
    end = time.monotonic() + 60.0
    while not (reader.inlet.linked and writer.outlet.count_groups("pose")):
        assert time.monotonic() < end
        writer.watch.poll()
        reader.inlet.take()
        for inlet in tuple(reader.apart):
            inlet.reach()


def make(folder: Path, real: bool) -> tuple[End, End]:
    writer, reader = End(folder / "out", real).listen(), End(folder / "out").read_from()
    link(writer, reader)
    return writer, reader


@pytest.fixture
def ends(tmp_path) -> Iterator[tuple[End, End]]:
    """A sender and a reader of one stream on the simulated clock."""
    writer, reader = make(tmp_path, real=False)
    yield writer, reader
    reader.inlet.close()
    writer.outlet.close()


def test_frames_of_any_size_arrive_whole_and_in_order(ends):
    writer, reader = ends
    sent = [bytes([i]) * size for i, size in enumerate(SIZES)]
    sender = threading.Thread(target=lambda: [writer.send(data) for data in sent])
    sender.start()
    assert [reader.next() for _ in sent] == sent
    sender.join()
    assert reader.inlet.take() == []


@pytest.mark.parametrize("linked", [True, False])
def test_a_wait_ends_at_its_deadline(ends, tmp_path, linked):
    """Not after twice the time, nor before it; also while the sender does not listen."""
    inlet = ends[1].inlet if linked else End(tmp_path / "none").read_from().inlet
    took = []
    for _ in range(8):
        begun = time.monotonic_ns()
        assert inlet.wait_until(begun + 30_000_000) == []
        took.append(1e-6 * (time.monotonic_ns() - begun))
    assert 29.0 < min(took) < 55.0
    begun = time.monotonic_ns()
    assert inlet.wait_until(begun - 10**9) == [] and time.monotonic_ns() - begun < 10**9


@pytest.mark.parametrize("how", ["closed", "dropped"])
def test_a_socket_that_is_closed_is_not_watched(ends, how):
    """The system gives its number to the next socket, whose messages would wake the wrong reader."""
    writer, reader = ends
    assert reader.watch._calls
    if how == "closed":
        reader.inlet.close()
    else:
        writer.outlet.close()
        end = time.monotonic() + 10.0
        while reader.inlet.linked and time.monotonic() < end:
            reader.inlet.take()
        assert reader.inlet in reader.apart
    assert not reader.watch._calls


def test_a_reader_does_not_wait_for_an_outlet_that_accepts_no_connection(tmp_path):
    """A blocking connection to a stopped process would stop the force path of its readers."""
    path = str(tmp_path / "stopped")
    others = []
    with socket.socket(socket.AF_UNIX) as stopped:
        stopped.bind(path)
        stopped.listen(0)
        with pytest.raises(BlockingIOError):
            for _ in range(100):
                others.append(socket.socket(socket.AF_UNIX))
                others[-1].setblocking(False)
                others[-1].connect(path)
        reader = End(Path(path))
        thread = threading.Thread(target=reader.read_from, daemon=True)
        thread.start()
        thread.join(5.0)
        assert not thread.is_alive() and reader.inlet in reader.apart
        for other in others:
            other.close()


def test_a_full_connection_blocks_its_sender_and_loses_nothing(ends):
    writer, reader = ends
    count = 30_000
    sender = threading.Thread(target=lambda: [writer.send(b"%d" % i + bytes(300)) for i in range(count)])
    sender.start()
    until = time.monotonic() + 60.0
    while not writer.held and time.monotonic() < until:
        time.sleep(0.01)
    assert writer.held and sender.is_alive()
    assert [int(reader.next()[:-300]) for _ in range(count)] == list(range(count))
    sender.join()


def test_a_blocked_sender_can_be_interrupted(ends):
    ends[0].most = 10
    with pytest.raises(TimeoutError):
        for _ in range(100_000):
            ends[0].send(bytes(500))


def test_a_closed_reader_does_not_block_the_sender(ends):
    writer, reader = ends
    reader.inlet.close()
    for _ in range(3000):
        writer.send(bytes(500))
    assert not writer.held and not writer.sender.readers


def test_a_reader_that_ends_releases_its_blocked_sender(tmp_path):
    writer, reader = make(tmp_path, real=False)

    def hold() -> None:
        writer.held += 1
        reader.inlet.close()
        assert writer.held < 3, "the sender still waits for a reader that has ended"

    writer.sender._holds = hold
    while not writer.held:
        writer.send(bytes(1000))
    writer.send(b"to nobody")
    assert writer.held == 1


def test_on_the_real_clock_frames_without_space_are_dropped_whole_and_counted(tmp_path):
    writer, reader = make(tmp_path, real=True)
    sent = [b"%6d" % i + bytes([i % 251]) * (100 if i % 3 else 150_000) for i in range(3000)]
    for data in sent:
        writer.send(data)
    received = reader.inlet.take()
    while (payloads := reader.inlet.take()) or reader.inlet._connection.decoder.rest:
        received += payloads
        writer.outlet.tend()  # the last one is sent in parts
    assert not writer.held and 10 < len(received) < len(sent)
    assert received == [sent[int(data[:6])] for data in received]
    writer.send(b"after")
    assert reader.next() == b"after"
    assert writer.outlet.notes() == [
        f"{len(sent) - len(received)} messages of group 'here' were dropped: the buffer of group 'there' was full"
    ]


def test_a_restarted_writer_is_found_and_a_partial_message_is_discarded(tmp_path):
    writer, reader = make(tmp_path, real=True)
    writer.send(b"old")
    writer.sender.readers[0].end.send(frame(b"pose\0" + bytes(5000))[:1000])
    writer.outlet.close()
    assert reader.next() == b"old"
    again = End(tmp_path / "out", real=True).listen()
    link(again, reader)
    again.send(b"new")
    assert reader.next() == b"new"


def test_a_restarted_reader_receives_new_messages(tmp_path):
    writer, reader = make(tmp_path, real=True)
    writer.send(b"while it was there")
    reader.inlet.close()
    writer.send(b"while it was down")
    again = End(tmp_path / "out").read_from()
    link(writer, again)
    writer.send(b"new")
    assert again.next() == b"new" and len(writer.sender.readers) == 1


# -- other programs ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("loaded", [False, True])
def test_a_libzmq_subscriber_reads_every_message(tmp_path, kind, loaded):
    writer = End(tmp_path / "out").listen()
    message = kind.example(loaded)
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.subscribe(b"pose\0")
        subscriber.connect(f"ipc://{writer.path}")
        writer.serve(lambda: bool(writer.sender.readers))
        writer.send(pack(message))
        assert subscriber.poll(60_000)
        assert subscriber.recv() == b"pose\0" + pack(message)
    writer.outlet.close()


def follow(reader: End, out: zmq.Socket) -> None:
    """Connect a reader to a publisher of libzmq."""
    out.bind(f"ipc://{reader.path}")
    reader.read_from()
    until = time.monotonic() + 60.0
    while not reader.inlet.linked:
        assert time.monotonic() < until
        reader.inlet.take()


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("loaded", [False, True])
def test_a_libzmq_publisher_sends_every_message(tmp_path, kind, loaded):
    reader = End(tmp_path / "out")
    with zmq.Context() as context, context.socket(zmq.XPUB) as out:
        follow(reader, out)
        assert out.poll(60_000) and out.recv() == b"\1pose\0"
        out.send(b"other\0" + b"not asked for")
        out.send(b"pose\0" + pack(kind.example(loaded)))
        assert pack(unpack(reader.next(), kind)) == pack(kind.example(loaded))
        reader.inlet.close()


@pytest.mark.parametrize("size", [0, 248, 250, 251, 252, CHUNK, 3_000_000])
def test_sockets_of_libzmq_and_palpate_exchange_frames_of_any_size(tmp_path, size):
    writer, reader = End(tmp_path / "out").listen(), End(tmp_path / "pub")
    data = os.urandom(size)
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber, context.socket(zmq.PUB) as out:
        subscriber.subscribe(b"")
        subscriber.connect(f"ipc://{writer.path}")
        out.set(zmq.SNDHWM, 0)  # otherwise a starved thread of libzmq drops the last message after many first ones
        out.bind(f"ipc://{reader.path}")
        writer.serve(lambda: bool(writer.sender.readers))
        writer.send(data)
        writer.serve(lambda: not writer.outlet._unfinished)
        assert subscriber.poll(60_000) and subscriber.recv() == b"pose\0" + data
        reader.read_from()
        until = time.monotonic() + 60.0
        while not reader.inlet.take():
            assert time.monotonic() < until
            out.send(b"pose\0first")
        out.send(b"pose\0" + data + b"!")
        while (payload := reader.next()) == b"first":
            pass
        assert payload == data + b"!"
        reader.inlet.close()
    writer.outlet.close()


def test_a_libzmq_subscriber_may_cancel_and_ping(tmp_path, monkeypatch):
    answers: list[bytes] = []
    monkeypatch.setattr(outlet_module, "pong", lambda *printed: answers.append(pong(*printed)) or answers[-1])
    writer = End(tmp_path / "out").listen()
    with zmq.Context() as context, context.socket(zmq.XSUB) as subscriber:
        subscriber.set(zmq.HEARTBEAT_IVL, 20)
        subscriber.set(zmq.HEARTBEAT_TIMEOUT, 60_000)
        events = subscriber.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        subscriber.connect(f"ipc://{writer.path}")
        subscriber.send(b"\1po")
        writer.serve(lambda: bool(writer.sender.readers))
        writer.serve(lambda: sum(answer is not None for answer in answers) >= 5)
        assert not events.poll(100), "it did not accept the answers to its pings"
        subscriber.send(b"\0po")
        writer.serve(lambda: not writer.sender.readers)
        subscriber.disable_monitor()
    writer.serve(lambda: not writer.outlet._readers)
    assert not writer.outlet.notes()
    writer.outlet.close()


def test_messages_of_several_frames_and_of_other_streams_are_dropped(tmp_path):
    reader = End(tmp_path / "out")
    with zmq.Context() as context, context.socket(zmq.XPUB) as out:
        follow(reader, out)
        assert out.poll(60_000)
        out.send_multipart([b"pose\0", b"pose\0payload", b"pose\0end"])
        out.send(b"pose\0good")
        assert reader.next() == b"good"
        reader.inlet.close()


# -- hostile peers -------------------------------------------------------------------------------------------------


def stranger(writer: End, *printed: bytes) -> socket.socket:
    """A program that has connected and sent this data."""
    end = socket.socket(socket.AF_UNIX)
    end.connect(writer.path)
    for data in printed:
        end.sendall(data)
    end.settimeout(60.0)
    return end


HOSTILE = {
    "speaks HTTP": b"GET / HTTP/1.1\r\n\r\n",
    "speaks ZMTP 2.0": bytes.fromhex("ff00000000000000017f01") + b"\x02\x00\x00",
    "wants CURVE": GREETING[:12] + b"CURVE" + bytes(47),
    "is no subscriber": GREETING + ready({b"Socket-Type": b"PUSH"}),
    "announces 2^63 bytes": GREETING + SUB + b"\x02" + (1 << 63).to_bytes(8, "big"),
    "announces a long command": GREETING + SUB + b"\x06" + (2000).to_bytes(8, "big"),
    "has flags that do not exist": GREETING + SUB + b"\xff\xff",
}


@pytest.mark.parametrize("how", sorted(HOSTILE))
def test_a_peer_that_violates_the_protocol_is_refused_and_named(ends, how):
    writer, reader = ends
    end = stranger(writer, HOSTILE[how])
    writer.serve(lambda: bool(writer.outlet.notes()))
    writer.send(b"goes on")
    assert reader.next() == b"goes on"
    while end.recv(4096):  # a greeting, then the connection is closed
        pass
    (note,) = writer.outlet.notes()
    assert note.startswith(f"a reader of group 'here' was refused, process {os.getpid()}: ")


def test_a_peer_without_subscription_gets_nothing_and_blocks_no_one(ends):
    writer, reader = ends
    end = stranger(writer, GREETING + SUB)
    writer.serve(
        lambda: all(one.connection.peer for one in writer.outlet._readers) and len(writer.outlet._readers) == 2
    )
    writer.send(b"to one")
    assert reader.next() == b"to one" and len(writer.sender.readers) == 1
    end.close()
    writer.serve(lambda: len(writer.outlet._readers) == 1)
    assert writer.outlet.notes() == []


def test_a_peer_that_stops_reading_loses_messages_and_blocks_no_one(ends):
    writer, reader = ends
    end = stranger(writer, GREETING + SUB + command(b"SUBSCRIBE", b""))
    writer.serve(lambda: len(writer.sender.readers) == 2)
    for k in range(300):
        writer.send(b"%d" % k + bytes(100_000))
        assert int(reader.next()[:-100_000]) == k
    dropped = max(given.dropped for given in writer.sender.readers)
    assert dropped > 100
    end.close()
    writer.serve(lambda: len(writer.outlet._readers) == 1)
    assert writer.outlet.notes() == [
        f"{dropped} messages of group 'here' were dropped: the buffer of process {os.getpid()} was full"
    ]


def test_a_writer_that_announces_too_long_a_frame_is_disconnected_and_retried(tmp_path):
    reader = End(tmp_path / "out")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(reader.path)
        listener.listen()
        reader.read_from()
        for _ in range(2):
            until = time.monotonic() + 60.0
            while not reader.inlet._socket and time.monotonic() < until:
                reader.inlet.reach()
            with listener.accept()[0] as end:
                end.sendall(GREETING + ready({b"Socket-Type": b"PUB"}) + b"\x02" + (1 << 62).to_bytes(8, "big"))
                reader.inlet.take()
            assert reader.inlet._socket is None and reader.apart == {reader.inlet}


TURNS = 50
PASS_ON = """
import os, sys
from palpate.launch.run.wire.inlet import Inlet
from palpate.launch.run.wire.outlet import Outlet
from palpate.launch.run.wire.watch import SocketPoller

here, there, first = sys.argv[1], sys.argv[2], sys.argv[3] == "first"
watch, apart = SocketPoller(), set()
outlet = Outlet("a", {"pose": ("a",)}, False, watch)
outlet.bind(here)
out = outlet.sender("pose", None, lambda: None)
inlet = Inlet("pose", "a", watch, lambda it: it.linked or it.take(), apart)
inlet.connect(there)
while not (inlet.linked and out.readers):
    watch.poll(1)
    for it in tuple(apart):
        it.reach()
if first:
    out.send(b"x" * 300)
for turn in range(60):
    if turn == 5:
        os.write(1, b"begin")
    if turn == 55:
        os.write(1, b"end")
    while not (payloads := inlet.wait()):
        pass
    out.send(payloads[0])
"""


def test_a_hop_is_one_write_and_one_read(tmp_path):
    strace = shutil.which("strace")
    if strace is None or subprocess.run([strace, "-o", "/dev/null", "true"], capture_output=True).returncode:
        pytest.skip("needs strace, and permission to trace")
    a, b, log = tmp_path / "a", tmp_path / "b", tmp_path / "calls"
    other = subprocess.Popen([sys.executable, "-c", PASS_ON, b, a, "first"], stdout=subprocess.DEVNULL)
    command = [strace, "-qq", "-e", "signal=none", "-o", log, sys.executable, "-c", PASS_ON, a, b, "second"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=60)
    other.wait(60)
    lines = log.read_text().splitlines()
    begin, end = (next(i for i, line in enumerate(lines) if f'write(1, "{mark}"' in line) for mark in ("begin", "end"))
    calls = [line.partition("(")[0] for line in lines[begin + 1 : end]]
    assert calls == ["recvfrom", "sendto"] * TURNS


# -- runs ----------------------------------------------------------------------------------------------------------


def pose(tick: int) -> Pose:
    return Pose(position=(0, 0, 0), velocity=(0, 0, 0), dt=1e-3, tick=tick)


def test_an_input_drops_duplicates_and_older_messages():
    port = Input(InputJob("pose", "source", "source"), inputs(Spring)[0], None)
    for tick in (0, 2, 2, 1, 4):
        port.put(pose(tick))
    assert [m.tick for m in port.queue] == [0, 2, 4]
    assert port.of(1) is None and port.of(2).tick == 2 and port.newest(3).tick == 2
    port.put(pose(3))
    assert [m.tick for m in port.queue] == [4]


def recorded(folder, text: str, ticks: int, place: str | None) -> list[tuple[str, int, bytes]]:
    """Stream, tick and payload of all messages of a run, sorted by stream and tick."""
    file = folder / f"{place}.mcap"
    launch = LaunchFile(graph=write_graph(folder, text), place=place, duration=ticks / 1000, record=file)
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return sorted(Recording(file).payloads())


def test_small_and_large_messages_of_one_stream_are_the_same_between_processes(tmp_path):
    text = GRAPH.replace("nodes_for_runs.Spread,", "nodes_for_runs.Swell,")
    alone = recorded(tmp_path, text, 200, "fused")
    assert max(len(payload) for _, _, payload in alone) > CHUNK
    assert recorded(tmp_path, text, 200, None) == alone


def test_a_sender_far_ahead_of_its_reader_loses_nothing(tmp_path):
    alone = recorded(tmp_path, AHEAD, 6000, "fused")
    assert len(alone) == 12_000 and recorded(tmp_path, AHEAD, 6000, None) == alone


def test_a_reader_that_dies_far_behind_ends_the_run(tmp_path):
    graph = write_graph(tmp_path, AHEAD.replace("doze", "doze and die"))
    outcome = execute(LaunchFile(graph=graph, duration=5000.0))
    assert [death.node for death in outcome.result.deaths] == ["spring"]


def test_a_reader_that_has_ended_does_not_block_its_sender(tmp_path):
    """It has no step after tick 0 and waits for nothing."""
    graph = write_graph(tmp_path, AHEAD.replace("how: doze", "every: 30000"))
    outcome = execute(LaunchFile(graph=graph, duration=20.0))
    assert outcome.result.ok and outcome.result.health["source"]["tick"] == 19_999


def test_a_slow_branch_next_to_a_fast_one_causes_no_deadlock(tmp_path):
    """`sum` waits for `drag` of a later tick while the source's stream, which it reads each tick, fills its buffer."""
    text = """
wanted: [sum]
nodes:
  source: {use: nodes_for_runs.Source}
  spring: {use: nodes_for_runs.Spring, in: {pose: source}, every: 4000}
  sum:    {use: nodes_for_runs.Drag, in: {pose: source, force: spring}, every: 4000}
"""
    graph = write_graph(tmp_path, text)
    outcome = execute(LaunchFile(graph=graph, duration=12.0))
    assert outcome.result.ok and outcome.result.health["sum"]["steps"] == 3


def test_a_run_continues_with_foreign_peers_and_names_them(tmp_path):
    received: list[bytes] = []

    def look(launcher: Launcher) -> None:
        if launcher.phase == "running" and not threads:
            threads.append(threading.Thread(target=visit, args=(launcher.run_id,)))
            threads[0].start()
        if threads and not threads[0].is_alive():
            launcher.stop()

    def visit(run: str) -> None:
        path = endpoint(run, "spring", "force")
        ends = []
        for printed in HOSTILE.values():
            ends.append(socket.socket(socket.AF_UNIX))
            ends[-1].connect(path.removeprefix("ipc://"))
            ends[-1].sendall(printed)
        with zmq.Context() as context, context.socket(zmq.SUB) as socket_:
            socket_.subscribe(b"spring\0")
            socket_.connect(path)
            if socket_.poll(60_000):
                received.append(socket_.recv())
        for end in ends:
            end.settimeout(60.0)
            while end.recv(4096):  # a greeting; then it was closed
                pass
            end.close()

    threads: list[threading.Thread] = []
    launch = LaunchFile(graph=write_graph(tmp_path, GRAPH.replace("logger.Mcap", "nodes_for_runs.Slow")))
    plan = launch.plan()
    result = Launcher(jobs(plan, launch.placement(plan), clock="real", ticks=60_000), show=look).run()
    threads[0].join()
    assert result.ok, result.deaths
    assert received and unpack(received[0].removeprefix(b"spring\0"), Force).source == "spring"
    refused = [note for note in result.notes if "a reader of group 'spring' was refused" in note]
    assert len(refused) == len(HOSTILE)
