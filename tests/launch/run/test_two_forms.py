"""Rules that exist in Python and in compiled code: both on random inputs, with equal results to the byte.

docs/architecture.md lists all pairs, and the tests of the others.
"""

import ctypes
import random
import socket
from types import SimpleNamespace

import numpy as np
import pytest
from frame_stream import TOPIC, Stream
from guarded import Form

from palpate.compiler.entry_point import entry_point
from palpate.compiler.kernel import kernel
from palpate.compiler.memory import set_word
from palpate.engine import compiled_tick
from palpate.engine.compiled_tick import clock_at, gather_inputs, row_at
from palpate.engine.encode import encode
from palpate.engine.health import Histogram
from palpate.engine.job import InputJob
from palpate.engine.slot import Input, Slot
from palpate.engine.table import CLOCK, INPUT, ROW
from palpate.launch.run.hop.frames import deliver, exactly, newest, port_at, reader_at, segment_at, send
from palpate.launch.run.hop.table import HOP, OUTPUT, READER, SEGMENT
from palpate.launch.run.hop.tick import hop_at, tally
from palpate.launch.run.wire.zmtp import frame
from palpate.launch.run.work import real
from palpate.messages import Contact, Friction, MessageError, Torque, pack
from palpate.messages.checks import check_finite
from palpate.messages.record import blank, writer
from palpate.nodes.base import Port
from palpate.nodes.base.block import ENTRY

CASES = 10_000


@kernel
def count_duration(words, duration):
    tally(words, duration)
    return 0


def test_durations_are_counted_in_the_same_bins():
    rng, counted, words = random.Random(1), Histogram(), Histogram().words
    count = entry_point(count_duration, 0, 0)
    for _ in range(CASES):
        duration = rng.getrandbits(rng.randint(0, 47))
        counted.add(duration)
        count(words.ctypes.data, duration)
    assert counted.words.tobytes() == words.tobytes()


@kernel
def is_finite(address):
    return 1 if compiled_tick.finite(row_at(address)) else 0


def test_the_same_messages_have_a_number_that_is_not_finite():
    rng, kind = random.Random(2), Contact
    record, row, found = blank(kind), np.zeros(1, ROW), set()
    names = [name for name in record.dtype.names if record.dtype[name].base == np.dtype("<f8")]
    write, check = writer(kind, tuple(names)), entry_point(is_finite, 0)
    flat = [at for name in names for at in places(record.dtype, name)]
    numbers = record.ctypes.data + np.array(flat, np.int64)
    row["numbers"], row["numbered"] = numbers.ctypes.data, len(numbers)
    example = kind.example(True)
    for _ in range(CASES):
        values = {name: odd(getattr(example, name), rng) for name in names if rng.random() < 0.3}
        message = kind(**({f: getattr(example, f) for f in example.__struct_fields__} | values))
        write(message, record.view(np.uint8).data)
        try:
            check_finite(message)
            expected = 1
        except MessageError:
            expected = 0
        assert check(row.ctypes.data) == expected, message
        found.add(expected)
    assert found == {0, 1}


def places(dtype, name):
    """Offsets of the numbers of a field."""
    form, at = dtype.fields[name][:2]
    return [at + 8 * k for k in range(form.itemsize // 8)]


def odd(value, rng):
    """Another number, or several, of any size, rarely NaN or infinite."""
    if isinstance(value, tuple):
        return tuple(odd(each, rng) for each in value)
    special = rng.choice((0.0, -0.0, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf")))
    return special if rng.random() < 0.2 else rng.uniform(-1e3, 1e3)


@kernel
def gather_row(row_address, at, clock_address, found):
    complete, present, time = gather_inputs(row_at(row_address), row_at(row_address).last, at, clock_at(clock_address))
    set_word(found, present)
    set_word(found + 8, time)
    return 1 if complete else 0


class Row:
    """A node with three inputs on the real clock, in the table and as a slot whose messages have arrived."""

    def __init__(self, rng: random.Random) -> None:
        self.tick, self.rate = rng.randint(0, 60), rng.choice((500.0, 1000.0, 4000.0))
        self.row, self.clock, self.lines = np.zeros(1, ROW), np.zeros(1, CLOCK), np.zeros(3, INPUT)
        self.heads, self.words = [blank(Torque) for _ in range(3)], np.zeros(16, np.int64)
        hardware, due, follows = (
            rng.random() < 0.2,
            max(0, self.tick - rng.choice((0, 0, 1, 5, 30))),
            rng.choice((0, 0, 1, 1, 1, 2, 3)),
        )
        self.row["inputs"], self.row["input"], self.row["used"] = 3, self.lines.ctypes.data, self.words[8:].ctypes.data
        self.row["hardware"], self.row["due"], self.row["follows"], self.row["last"] = hardware, due, follows, self.tick
        self.clock["real"], self.clock["rate"] = True, self.rate
        self.slot = SimpleNamespace(
            inputs=[], driver=None, drivers=[], follows=follows > 0, due=due, joined=False,
            node=SimpleNamespace(hardware=hardware), health=SimpleNamespace(held=0, absent=0),
        )  # fmt: skip
        self.permitted = {}
        for k, (line, head) in enumerate(zip(self.lines, self.heads, strict=True)):
            self._input(rng, k, line, head)
        self.slot.driver = self.slot.inputs[0] if follows else None
        self.slot.drivers = self.slot.inputs[:follows] if follows > 1 else []
        self.slot.drives = lambda port: Slot.drives(self.slot, port)

    def _input(self, rng: random.Random, k: int, line: np.ndarray, head: np.ndarray) -> None:
        every, loop, optional = rng.choice((1, 1, 2, 5)), k > 0 and rng.random() < 0.2, rng.random() < 0.4
        dead, permitted = rng.random() < 0.1, rng.choice((0.001, 0.004, 0.012))
        job = InputJob(f"p{k}", "stream", "sender", waits=False, every=every, loop=loop)
        port = Input(job, Port(f"p{k}", Torque, optional=optional, wants=frozenset()), None)
        port.dead = dead
        limit = self.tick - loop
        if rng.random() < 0.85 and limit >= 0:
            tick = max(0, limit - rng.choice((0, 0, 0, 1, 2, 3, 9, 40)))
            port.put(Torque(torques=(0.0, 0.0, 0.0), tick=tick, time=1000 * tick + k))
            head["there"], head["tick"], head["time"] = True, tick, 1000 * tick + k
        self.slot.inputs.append(port)
        self.permitted[port] = permitted
        line["record"], line["absent"], line["put"] = head.ctypes.data, head.ctypes.data, self.words[k:].ctypes.data
        line["every"], line["loop"], line["permitted"] = every, loop, permitted
        line["dead"], line["optional"], line["drives"] = dead, optional, k == 0 and self.row["follows"][0] == 1


def test_a_step_takes_the_same_messages(monkeypatch):
    """Fresh, held, too old, missed and missing ones of three inputs, with divisors, loops, and a node that slept."""
    rng, gather, kinds = random.Random(3), entry_point(gather_row, 0, 0, 0, 0), set()
    for _ in range(CASES):
        one = Row(rng)
        monkeypatch.setattr(real, "permitted_age", lambda job, slot, port, one=one: one.permitted[port])
        worker = SimpleNamespace(job=SimpleNamespace(rate=one.rate), stopping=False)
        expected = real.take_inputs(worker, one.slot, one.tick, 0, True)
        found = one.words[6:]
        complete = gather(one.row.ctypes.data, 5, one.clock.ctypes.data, found.ctypes.data)
        assert bool(complete) == (expected is not None)
        assert (one.row["held"][0], one.row["absent"][0]) == (one.slot.health.held, one.slot.health.absent)
        if expected is not None:
            assert [bool(found[0] >> k & 1) for k in range(3)] == [each is not None for each in expected]
            assert one.words[8:11].tolist() == [-1 if each is None else each.tick for each in expected]
            assert found[1] == Slot.time_of(one.slot, expected, 5)
        kinds.add((bool(complete), one.slot.health.held > 0, one.slot.health.absent > 0))
    assert len(kinds) >= 5, kinds


@kernel
def pick_newest(address, limit, due, every, found):
    state, count, runs = newest(port_at(address), limit, due, every)
    set_word(found, count)
    set_word(found + 8, runs)
    return state


@kernel
def pick_exactly(address, need):
    return 1 if exactly(port_at(address), need) else 0


class Queue:
    """A port that reads frames of a socket, and an input that gets the same messages."""

    def __init__(self) -> None:
        self.stream, self.found = Stream(), np.zeros(2, np.int64)
        self._newest, self._exactly = entry_point(pick_newest, 0, 0, 0, 0, 0), entry_point(pick_exactly, 0, 0)

    def begin(self, rng: random.Random, far: socket.socket, near: socket.socket) -> None:
        self.input = Input(None, Port("p", Torque, optional=False, wants=frozenset()), None)
        self.stream.begin(far.fileno(), 8000)
        tick = rng.randint(0, 3)
        for _ in range(rng.randint(0, 6)):
            message = Torque(torques=(0.0, 0.0, 0.0), tick=tick, time=tick, source="src", used=())
            near.send(frame(TOPIC + pack(message)))
            self.input.put(message)
            tick = max(0, tick + rng.choice((1, 1, 1, 2, 3, 0, -1)))
        self.stream._receive(self.address)

    @property
    def address(self) -> int:
        return self.stream.port.ctypes.data

    @property
    def tick(self) -> int:
        """Tick of the message of the port, -1: none."""
        place = int(self.stream.port["record"][0])
        head = np.frombuffer(ctypes.string_at(place, self.stream.size), blank(Torque).dtype)
        return int(head["tick"][0]) if head["there"][0] else -1

    def newest(self, limit: int, due: int, every: int) -> tuple[int, int]:
        self._newest(self.address, limit, due, every, self.found.ctypes.data)
        return self.found.tolist()

    def exactly(self, need: int) -> bool:
        return bool(self._exactly(self.address, need))


def test_the_newest_message_is_the_same_and_skipped_runs_are_counted_in_both():
    """Frames in order, with gaps, duplicates and older ones; the limit at any of them."""
    rng, queue, most = random.Random(4), Queue(), 0
    for _ in range(CASES):
        near, far = socket.socketpair()
        with near, far:
            queue.begin(rng, far, near)
            every, due = rng.choice((1, 2, 5)), rng.randint(0, 4)
            limit, slot = rng.choice((3, 6, 1 << 40)), SimpleNamespace(every=every, due=due)
            waiting = [m for m in queue.input.queue if m.tick <= limit]
            runs = real._runs(slot, SimpleNamespace(queue=waiting))
            message = queue.input.newest(limit)
            assert queue.newest(limit, due, every) == [len(waiting), runs]
            assert queue.tick == (-1 if message is None else message.tick)
            most = max(most, runs)
    assert most >= 4


def test_the_message_of_a_tick_is_the_same_or_missing_in_both():
    rng, queue, found = random.Random(5), Queue(), set()
    for _ in range(CASES):
        near, far = socket.socketpair()
        with near, far:
            queue.begin(rng, far, near)
            near.shutdown(socket.SHUT_WR)  # nothing else arrives
            for need in sorted(rng.sample(range(9), 2)):
                message = queue.input.of(need)
                assert queue.exactly(need) == (message is not None)
                found.add((message is not None, queue.input.is_lost(need)))
                if message is None:
                    break
                assert queue.tick == message.tick
    assert found == {(True, False), (False, False), (False, True), (True, True)}, found


@kernel
def send_bytes(reader_address, begin, size, scratch):
    return send(reader_at(reader_address), begin, size, scratch)


def test_the_same_frames_are_sent():
    rng, reader, scratch = random.Random(6), np.zeros(1, READER), np.zeros(32, np.int64)
    sent, head = entry_point(send_bytes, 0, 0, 0, 0), np.frombuffer(bytes(9) + TOPIC, np.uint8).copy()
    near, far = socket.socketpair()
    with near, far:
        reader["fd"], reader["topic"], reader["skip"] = near.fileno(), head.ctypes.data + 9, len(TOPIC)
        for _ in range(CASES):
            payload = rng.randbytes(rng.choice((0, 1, 249, 250, 251, 252, rng.randint(0, 300), rng.randint(0, 9000))))
            data = np.frombuffer(payload or b"\0", np.uint8)
            assert sent(reader.ctypes.data, data.ctypes.data, len(payload), scratch.ctypes.data) == 0
            assert far.recv(1 << 16) == frame(TOPIC + payload)


@kernel
def deliver_tick(hop, segment, clock):
    return deliver(hop_at(hop), segment_at(segment), clock_at(clock))


@pytest.mark.parametrize("size", [30_000, 200_000])
def test_the_number_of_bytes_sent_before_a_buffer_is_full_is_known(size):
    """Python sends the rest of the frame from there on."""
    data, head = np.frombuffer(random.Random(9).randbytes(size), np.uint8), bytes(9) + TOPIC
    place, scratch = np.frombuffer(head, np.uint8).copy(), np.zeros(32, np.int64)
    hop, segment, clock = np.zeros(1, HOP), np.zeros(1, SEGMENT), np.zeros(1, CLOCK)
    entries, readers = np.zeros(1, ENTRY), np.zeros(1, READER)
    entries["end"] = size
    near, far = socket.socketpair()
    with near, far:
        near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        readers["fd"], readers["topic"], readers["skip"] = near.fileno(), place.ctypes.data + 9, len(TOPIC)
        segment["reader"], segment["readers"], hop["scratch"] = readers.ctypes.data, 1, scratch.ctypes.data
        clock["entry"], clock["entries"], clock["journal"] = entries.ctypes.data, 1, data.ctypes.data
        send = entry_point(deliver_tick, 0, 0, 0)
        assert send(hop.ctypes.data, segment.ctypes.data, clock.ctypes.data) == OUTPUT
        near.close()
        read = b"".join(iter(lambda: far.recv(1 << 16), b""))
    assert 0 < hop["sent"][0] == len(read) < size
    assert read == frame(TOPIC + data.tobytes())[: len(read)]


@pytest.mark.parametrize("kind", [Contact, Friction])
def test_the_same_bytes_are_encoded(kind):
    """Any numbers, flags and words of a message with arrays left empty; tests of the decoder go through all types."""
    rng, form, write_to = random.Random(7), Form(kind, "node"), np.zeros(1 << 14, np.uint8)
    names = tuple(name for name in kind.__struct_fields__ if name in form.blank.dtype.names)
    write, encoded, used = writer(kind, names), entry_point(encode, 0, 0, 0, 0, 0, 0, 0), np.zeros(4, np.int64)
    example = kind.example(True)
    given = {name: getattr(example, name) for name in example.__struct_fields__}
    for _ in range(CASES):
        ticks = tuple(rng.choice((-1, 0, 127, 128, 65_536, rng.getrandbits(40))) for _ in range(rng.randint(0, 4)))
        values = {n: odd(v, rng) for n, v in given.items() if isinstance(v, float) or is_vector(v)}
        flags = {n: rng.random() < 0.5 for n, v in given.items() if isinstance(v, bool)}
        header = {
            "tick": rng.getrandbits(rng.randint(0, 62)),
            "time": rng.getrandbits(60),
            "used": ticks,
            "source": "node",
        }
        message = kind(**(given | values | flags | header))
        write(message, form.blank.view(np.uint8).data)
        used[: len(ticks)] = ticks
        where = (
            form.plan.steps.ctypes.data,
            len(form.plan.steps),
            form.plan.literals.ctypes.data,
            form.blank.ctypes.data,
        )
        end = encoded(*where, used.ctypes.data, len(ticks), write_to.ctypes.data)
        assert bytes(write_to[: end - write_to.ctypes.data]) == pack(message)


def is_vector(value):
    return isinstance(value, tuple) and bool(value) and all(isinstance(each, float) for each in value)


@pytest.mark.parametrize("name", ["nanoseconds", "begin_of", "next_run", "needed_tick", "left_out", "unread"])
def test_compiled_rules_are_the_functions_of_python(name):
    """Compiled from the same source; only arithmetic could differ."""
    from palpate.engine import schedule

    plain = getattr(schedule, name)
    compiled, rng = kernel(plain), random.Random(8)
    draw = {
        "nanoseconds": lambda: (
            rng.getrandbits(rng.randint(1, 40)),
            rng.choice((1000.0, 333.3, rng.uniform(100, 2e4))),
        ),
        "begin_of": lambda: (rng.getrandbits(rng.randint(1, 38)), rng.uniform(5e4, 1e7)),
        "next_run": lambda: (rng.getrandbits(40), rng.randint(1, 50)),
        "needed_tick": lambda: (rng.randint(0, 99), rng.randint(1, 50), rng.random() < 0.5),
        "left_out": lambda: (rng.uniform(-1e6, 1e8), rng.uniform(1e5, 1e7), rng.randint(0, 99), rng.randint(99, 200)),
        "unread": lambda: tuple(rng.randint(0, 9) for _ in range(4)),
    }[name]
    for _ in range(CASES):
        given = draw()
        assert compiled(*given) == plain(*given), given
