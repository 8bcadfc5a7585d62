"""The compiled hop: a worker sends the same bytes as by the loops in Python, whatever arrives and with any readers."""

import contextlib
import os
import random
import threading
import time
from collections.abc import Callable, Iterator, Sequence

import msgpack
import msgspec
import pytest
import zmq

from palpate.engine.clock import now
from palpate.engine.job import InputJob, Job, NodeJob
from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import NodeError
from palpate.launch.run.hop.hop import Hop
from palpate.launch.run.wire.addresses import RunFolder, endpoint
from palpate.launch.run.wire.bus import Bus
from palpate.launch.run.wire.inlet import Inlet
from palpate.launch.run.wire.outlet import Outlet, Sender
from palpate.launch.run.wire.watch import SocketPoller
from palpate.launch.run.wire.zmtp import COMMAND, MORE, Decoder, command, frame
from palpate.launch.run.work.real import run_real
from palpate.launch.run.work.simulated import SimulatedClock
from palpate.launch.run.work.worker import Worker
from palpate.messages import MessageError, Torque, pack, unpack

RUN = f"hop-{os.getpid()}"
TICKS = 300
FIRST = InputJob("first", "pose", "src")
SECOND = InputJob("second", "pose", "src", loop=True, optional=True, rank=-1)
NODES = (
    NodeJob("a", "nodes_for_placement.CompiledOne", {}, 1, (FIRST, SECOND), ("a",)),
    NodeJob("b", "nodes_for_placement.CompiledTwo", {}, 2, (InputJob("first", "a", "a"),), ("b.Torque", "b.Force")),
    NodeJob("c", "nodes_for_placement.CompiledOne", {}, 1, (FIRST,), ("c",)),
)
"""A segment with two nodes, and one that waits for the stream again; it is read by an edge and by a loop."""
STREAMS = ("a", "b.Torque", "b.Force", "c")
HOLDS = NodeJob("d", "nodes_for_placement.CompiledOne", {}, 1,
                (FIRST, InputJob("second", "body", "far", loop=True, optional=True, rank=-1)), ("d",))  # fmt: skip
"""A node that holds the message of another sender."""


def message(tick: int) -> Torque:
    numbers = [(tick * k % 7) / 7.0 for k in (1, 2, 3)]
    return Torque(torques=tuple(numbers), tick=tick, time=tick * 1_000_000, source="src", used=(tick - 1,))


def framed(tick: int) -> bytes:
    return frame(b"pose\0" + pack(message(tick)))


class Bench:
    """A worker in this process, the outlets that it reads, and an inlet for each of its streams."""

    def __init__(
        self,
        compiled: bool,
        nodes: Sequence[NodeJob] = NODES,
        real: bool = False,
        publisher: zmq.Socket | None = None,
    ) -> None:
        streams = [stream for node in nodes for stream in node.streams]
        external = {stream: ("sink",) for stream in streams}
        self.folder = RunFolder(RUN)
        self.watch, apart = SocketPoller(), set[Inlet]()
        names = {node.name for node in nodes}
        read = {given.stream: given.producer for node in nodes for given in node.inputs if given.producer not in names}
        self.outlets: dict[str, Outlet] = {}
        self.senders: dict[str, Sender] = {}
        if publisher is not None:  # sends in place of the outlet
            publisher.bind(endpoint(RUN, "src", "force"))
        for stream, producer in read.items() if publisher is None else ():
            self.outlets[stream] = Outlet(producer, {stream: ("here",)}, real, self.watch)
            self.outlets[stream].bind(endpoint(RUN, producer, "force").removeprefix("ipc://"))
            self.senders[stream] = self.outlets[stream].sender(stream, None, self.watch.poll)
        control = (endpoint(RUN, "launcher", name) for name in ("control", "reports"))
        self.bus = Bus(RUN, "here", *control, real, external)
        clock = "real" if real else "simulated"
        job = Job("here", nodes, external=external, clock=clock, ticks=TICKS if real else None)
        self.worker = Worker(job, self.bus, lambda report: None)
        self.worker.start()
        force = self.bus.bind(None)["force"][0]
        for stream, producer in read.items():
            self.bus.connect(endpoint(RUN, producer, "force"), [stream], False, False, producer)
        self.inlets = [Inlet(stream, "sink", SocketPoller(), lambda inlet: None, apart) for stream in streams]
        for inlet in self.inlets:
            inlet.connect(force.removeprefix("ipc://"))
        until = time.monotonic() + 30.0
        while not self.linked():
            assert time.monotonic() < until
            self.watch.poll()
            for inlet in tuple(apart):
                inlet.reach()
            for inlet in (*self.bus.sweep(), *self.inlets):
                inlet.take()
        self.worker.begin(now())
        self.worker.tick = -1
        assert isinstance(self.worker.hop, Hop)
        if not compiled:
            self.worker.hop = None
        self.payloads: dict[str, list[bytes]] = {stream: [] for stream in streams}
        self.tick, self.clock = 0, SimulatedClock(self.worker)

    def linked(self) -> bool:
        return bool(
            all(outlet.count_groups(stream) for stream, outlet in self.outlets.items())
            and all(self.bus.inlet(stream).linked for stream in self.worker.feeds)
            and all(self.bus._outlet.count_groups(inlet.stream) and inlet.linked for inlet in self.inlets)
        )

    def write(self, data: bytes) -> None:
        """Send raw bytes to the worker."""
        self.senders["pose"].readers[0].end.sendall(data)

    def read(self) -> None:
        """Read all that has arrived."""
        for inlet in self.inlets:
            while payloads := inlet.take():
                self.payloads[inlet.stream] += payloads

    def run(self, ticks: int = TICKS, read: bool = True) -> None:
        while self.tick < ticks:
            self.tick = self.clock.run(self.tick, ticks - self.tick)
            if read:
                self.read()
        self.read()

    def counts(self) -> list[tuple[int, ...]]:
        self.worker.heartbeat.send()
        health = [slot.health for slot in self.worker.slots]
        return [(h.tick, h.step.count + h.counted, h.asleep, h.lost, h.held) for h in health]

    def close(self) -> None:
        for inlet in self.inlets:
            inlet.close()
        self.worker.stop()
        for outlet in self.outlets.values():
            outlet.close()
        self.bus.close(False)
        self.folder.close()


@pytest.fixture
def bench(monkeypatch, tmp_path) -> Iterator[Callable[..., Bench]]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    made: list[Bench] = []

    def make(*given, **more) -> Bench:
        made.append(Bench(*given, **more))
        return made[-1]

    yield make
    for each in made:
        each.close()


def outcome(bench: Callable[..., Bench], compiled: bool, act: Callable[[Bench], None]) -> tuple:
    made = bench(compiled)
    act(made)
    answer = made.payloads, made.counts()
    made.close = lambda: None  # type: ignore[method-assign]
    Bench.close(made)
    return answer


def same(bench: Callable[..., Bench], act: Callable[[Bench], None], ticks: int = TICKS) -> None:
    """Both ways have the same outcome."""
    expected = outcome(bench, False, act)
    assert [len(expected[0][stream]) for stream in STREAMS] == [ticks, -(-ticks // 2), -(-ticks // 2), ticks]
    assert outcome(bench, True, act) == expected


def test_the_bytes_are_those_of_the_loop_in_python(bench):
    def act(made: Bench) -> None:
        made.write(b"".join(map(framed, range(TICKS))))
        made.run()

    same(bench, act)


def test_ticks_run_in_compiled_code(bench, monkeypatch):
    made = bench(True)
    monkeypatch.setattr(CompiledSegment, "run", None)
    made.write(b"".join(map(framed, range(TICKS))))
    made.run()
    assert len(made.payloads["c"]) == TICKS


def strange(tick: int, rng: random.Random) -> bytes:
    """The frame of a tick in an unusual form, or with others before it."""
    payload = pack(message(tick))
    form = msgspec.msgpack.decode(payload)
    match rng.randrange(9):
        case 0:  # another order of the fields
            return frame(b"pose\0" + msgpack.packb(dict(sorted(form.items(), key=lambda item: rng.random()))))
        case 1:  # a field more
            return frame(b"pose\0" + msgpack.packb(form | {"more": [1, 2.0, "x"]}))
        case 2:  # a long header of a short frame
            return b"\2" + (5 + len(payload)).to_bytes(8, "big") + b"pose\0" + payload
        case 3:
            return command(b"PING", b"\0\0hello") + framed(tick)
        case 4:  # duplicates
            return b"".join(framed(each) for each in range(max(0, tick - rng.randint(1, 3)), tick + 1))
        case 5:  # another stream
            return frame(b"other\0" + payload) + framed(tick)
        case 6:  # a message of several parts
            return frame(b"pose\0", 1) + frame(payload) + framed(tick)
        case 7:  # a message longer than the first buffer
            return frame(b"pose\0" + msgpack.packb(form | {"more": bytes(rng.choice((300, 200_000)))}))
        case _:  # whole numbers in place of floats
            return frame(b"pose\0" + msgpack.packb(form | {"torques": [1, 0, 1]}))


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(s, marks=pytest.mark.long) for s in range(4, 40))])
def test_unusual_frames_in_any_pieces_change_nothing(bench, seed):
    rng = random.Random(seed)
    share = rng.choice((0.02, 0.2, 1.0))
    data = b"".join(strange(k, rng) if rng.random() < share else framed(k) for k in range(TICKS))
    cuts = sorted(rng.randrange(len(data)) for _ in range(rng.choice((0, 5, 60))))
    pauses = [rng.choice((0.0, 0.0, 0.001, 0.03)) for _ in range(len(cuts) + 1)]

    def act(made: Bench) -> None:
        def write() -> None:
            for begin, end, pause in zip([0, *cuts], [*cuts, len(data)], pauses, strict=True):
                made.write(data[begin:end])
                time.sleep(pause)

        writer = threading.Thread(target=write)
        writer.start()
        made.run()
        writer.join()

    same(bench, act)


def test_a_slow_reader_loses_nothing(bench):
    ticks = 12_000

    def act(made: Bench) -> None:
        ended = threading.Event()

        def read() -> None:
            time.sleep(0.3)
            while not ended.is_set():
                made.read()

        def write() -> None:
            for tick in range(ticks):
                made.write(framed(tick))

        threads = [threading.Thread(target=each) for each in (read, write)]
        for each in threads:
            each.start()
        while made.tick < ticks:
            made.tick = made.clock.run(made.tick, ticks - made.tick)
        ended.set()
        for each in threads:
            each.join()
        made.read()

    same(bench, act, ticks)


def test_a_journal_without_room_grows(bench):
    def act(made: Bench) -> None:
        for part in made.worker.parts:
            part._clock["room"], part._clock["most"] = 100, 3
        made.write(b"".join(map(framed, range(TICKS))))
        made.run()

    same(bench, act)


def test_a_reader_that_ends_is_forgotten(bench):
    made = bench(True)
    made.write(b"".join(map(framed, range(TICKS))))
    made.run(100)
    gone = made.inlets.pop(0)
    gone.close()
    used = [os.open(os.devnull, os.O_RDONLY) for _ in range(8)]  # the numbers of closed descriptors are used again
    made.run()
    for number in used:
        os.close(number)
    assert len(made.payloads["a"]) >= 100 and len(made.payloads["c"]) == TICKS
    assert not made.bus._outlet.count_groups("a")


def test_a_lost_message_ends_the_run_with_its_tick(bench):
    for compiled in (False, True):
        made = bench(compiled)
        made.write(b"".join(framed(tick) for tick in range(TICKS) if tick != 77))
        with pytest.raises(NodeError, match=r"its message of tick 77 was lost"):
            made.run()
        made.read()
        assert len(made.payloads["a"]) == 77
        made.close()
        made.close = lambda: None


def test_garbage_ends_the_run_and_names_its_sender(bench):
    for compiled in (False, True):
        made = bench(compiled)
        made.write(b"".join(map(framed, range(50))) + frame(b"pose\0" + b"\x81\xa1x\xc0") + framed(50))
        with pytest.raises(NodeError, match=r"node 'src', stream 'pose'"):
            made.run()
        made.close()
        made.close = lambda: None


def test_an_infinite_number_is_an_error_of_the_node_after_its_last_message(bench):
    bad = msgspec.structs.replace(message(60), torques=(float("inf"), 0.0, 0.0))
    for compiled in (False, True):
        made = bench(compiled)
        made.write(b"".join(map(framed, range(60))) + frame(b"pose\0" + pack(bad)))
        with pytest.raises(NodeError, match=r"node 'a', step at tick 60"):
            made.run()
        made.read()
        assert [len(made.payloads[stream]) for stream in STREAMS] == [60, 30, 30, 60]
        made.close()
        made.close = lambda: None


def ticks(data: bytes) -> Iterator[int]:
    """The ticks of the messages of the stream in some frames, as msgspec reads them."""
    several = False
    for flags, body in Decoder(1 << 28).feed(data):
        if flags == 0 and body.startswith(b"pose\0") and not several:
            with contextlib.suppress(MessageError):
                yield unpack(body[5:], Torque).tick
        elif flags != COMMAND:
            several = flags == MORE


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(s, marks=pytest.mark.long) for s in range(3, 30))])
def test_on_the_real_clock_each_whole_message_is_a_step_or_counted_as_lost(bench, compiled, seed):
    """At 5 kHz, with garbage, strange and half frames, losses, duplicates, old messages, and pauses."""
    rng, made = random.Random(seed), bench(compiled, real=True)
    lost = rng.choice((0.0, 0.1, 0.8))
    sent: list[int] = []

    def write() -> None:
        for tick in range(TICKS):
            if tick + 1 < TICKS and rng.random() < lost:
                continue
            data = strange(tick, rng) if rng.random() < 0.2 else framed(tick)
            if rng.random() < 0.2:
                data = frame(b"pose\0" + pack(message(tick))[: rng.randint(0, 60)]) + data
            if rng.random() < 0.1:
                data += framed(max(0, tick - rng.randint(0, 5)))
            sent.extend(each for each in ticks(data) if each > (sent[-1] if sent else -1))
            cut = rng.randrange(len(data))
            made.write(data[:cut])
            time.sleep(rng.choice((0.0, 0.0002)))
            made.write(data[cut:])
            time.sleep(rng.choice((0.0002, 0.0002, 0.03 if rng.random() < 0.05 else 0.0)))

    writer = threading.Thread(target=write)
    writer.start()
    run_real(made.worker)
    writer.join()
    made.read()
    (tick, steps, _, missed, _), *_ = made.counts()
    assert tick == TICKS - 1 and steps == len(made.payloads["a"])
    assert steps + missed == len(sent)
    received = [msgspec.msgpack.decode(payload) for payload in made.payloads["a"]]
    assert [form["used"][0] for form in received] == [form["tick"] for form in received]
    assert {form["tick"] for form in received} <= set(sent)
    assert [form["tick"] for form in received] == sorted({form["tick"] for form in received})
    # The edge of the loop has the message before, if it arrived; an older one is held, and not beyond its age.
    for form in received[1:]:
        assert form["used"][1] < form["tick"] and (form["used"][1] in sent or form["used"][1] == -1)


def test_a_held_sender_that_closes_its_connection_does_not_end_compiled_execution(bench, monkeypatch):
    made = bench(True, [HOLDS], real=True)
    in_python: list[int] = []
    step = CompiledSegment.run

    def run(part: CompiledSegment, tick: int, host: SimulatedClock) -> None:
        in_python.append(tick)
        step(part, tick, host)

    monkeypatch.setattr(CompiledSegment, "run", run)

    def write() -> None:
        for tick in range(TICKS):
            if tick == 100:
                made.outlets["body"].close()
            made.write(framed(tick))
            time.sleep(0.0005)

    writer = threading.Thread(target=write)
    writer.start()
    run_real(made.worker)
    writer.join()
    assert made.worker.tick == TICKS - 1
    assert sum(tick > 100 for tick in in_python) < 50  # it was each of 200


def test_compiled_code_reads_a_publisher_of_libzmq(bench, monkeypatch):
    ordinary = bench(True)
    ordinary.write(b"".join(map(framed, range(TICKS))))
    ordinary.run()
    ordinary.close()
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        made = bench(True, publisher=publisher)
        monkeypatch.setattr(CompiledSegment, "run", None)
        assert publisher.poll(30_000) and publisher.recv() == b"\1pose\0"
        for tick in range(TICKS):
            publisher.send(b"pose\0" + pack(message(tick)))
        made.run()
        assert made.payloads == ordinary.payloads
        made.close()
    ordinary.close = made.close = lambda: None


@pytest.mark.parametrize("kind", [zmq.SUB, zmq.XSUB])
def test_libzmq_reads_each_stream(bench, kind):
    made = bench(True)
    with zmq.Context() as context, context.socket(kind) as reader:
        for stream in STREAMS:
            topic = stream.encode() + b"\0"
            reader.subscribe(topic) if kind == zmq.SUB else reader.send(b"\1" + topic)
        reader.connect(endpoint(RUN, "here", "force"))
        until = time.monotonic() + 30.0
        while not all(len(made.bus._outlet._senders[k].readers) == 2 for k in range(len(STREAMS))):
            assert time.monotonic() < until
            made.bus.sweep(5)
        made.write(b"".join(map(framed, range(TICKS))))
        made.run()
        read: dict[str, list[bytes]] = {stream: [] for stream in STREAMS}
        while reader.poll(1000) and len(read["c"]) < TICKS:
            name, _, payload = reader.recv().partition(b"\0")
            read[name.decode()].append(payload)
    assert read == made.payloads
