"""The compiled reader of ZMTP frames: any bytes in any pieces, in a buffer directly before an unreadable page."""

import ctypes
import random
import socket

import msgspec
import numpy as np
import pytest
from guarded import Form, Guarded

from palpate.compiler.entry_point import entry_point
from palpate.compiler.kernel import kernel
from palpate.engine.table import INPUT
from palpate.launch.run.hop.frames import CUT, DONTWAIT, ODD, WHOLE, fill, peek, port_at, take, wire_at
from palpate.launch.run.hop.table import PORT, WIRE
from palpate.launch.run.wire.zmtp import COMMAND, MORE, command, frame
from palpate.messages import MessageError, Torque, pack, unpack

TOPIC = b"pose\0"
ARENA = 64


@kernel
def read_frame(address):
    """Take the next message of a port; the state of its frame."""
    port = port_at(address)
    state = peek(port)
    if state == WHOLE:
        take(port)
    return state


@kernel
def receive(address):
    """Receive into the buffer of a port's wire."""
    return fill(wire_at(port_at(address).wire), DONTWAIT)


class Stream:
    """A port with a wire of `room` bytes; buffer, records and memory for arrays lie before unreadable pages."""

    def __init__(self) -> None:
        self._form, self._memory = Form(Torque, "src"), Guarded(2)
        self._pairs = [(Guarded(1), Guarded(1)) for _ in range(2)]
        self._topic, self._input = np.frombuffer(TOPIC, np.uint8), np.zeros(1, INPUT)
        self.wire, self.port = np.zeros(1, WIRE), np.zeros(1, PORT)
        self._read, self._receive = entry_point(read_frame, 0), entry_point(receive, 0)
        self.size = self._form.blank.nbytes

    def begin(self, number: int, room: int) -> None:
        """Read another connection."""
        wire, port = self.wire[0], self.port[0]
        wire["fd"], wire["buffer"], wire["room"], wire["end"] = number, self._memory.end - room, room, 0
        wire["topic"], wire["skip"], wire["port"] = self._topic.ctypes.data, len(TOPIC), self.port.ctypes.data
        port["wire"], port["line"] = self.wire.ctypes.data, self._input.ctypes.data
        port["begin"] = port["ahead"] = 0
        port["form"], port["space"] = self._form.address, ARENA
        for (record, arena), names in zip(self._pairs, (("record", "arena"), ("spare", "other")), strict=True):
            port[names[0]], port[names[1]] = record.end - self.size, arena.end - ARENA
            ctypes.memset(record.end - self.size, 0, self.size)

    def read(self) -> tuple[list[int], int]:
        """The ticks of the messages that have arrived, and the state of the frame after them."""
        ticks = []
        while True:
            self._receive(self.port.ctypes.data)
            while (state := self._read(self.port.ctypes.data)) == WHOLE:
                data = ctypes.string_at(int(self.port["record"][0]), self.size)
                ticks.append(int(np.frombuffer(data, self._form.blank.dtype)["tick"][0]))
            if state == ODD or self._receive(self.port.ctypes.data) <= 0:
                return ticks, state


def expected(data: bytes, room: int, read: int) -> tuple[list[int], int]:
    """As `Stream.read`, by the rules of RFC 23 and by msgspec. A valid message in another form than that of `pack` may
    be taken or not: it is if fewer than `read` messages precede it."""
    ticks: list[int] = []
    at = 0
    while True:
        left = len(data) - at
        if left < 2 or (data[at] == 2 and left < 9):
            return ticks, CUT
        if data[at] not in (0, 2):
            return ticks, ODD
        head = 2 if data[at] == 0 else 9
        length = data[at + 1] if head == 2 else int.from_bytes(data[at + 1 : at + 9], "big")
        if not len(TOPIC) <= length <= room - head:
            return ticks, ODD
        if left - head < length:
            return ticks, CUT
        body = data[at + head : at + head + length]
        if not body.startswith(TOPIC):
            return ticks, ODD
        try:
            message = unpack(body[len(TOPIC) :], Torque)
        except MessageError:
            return ticks, ODD
        if len(ticks) >= read and (pack(message) != body[len(TOPIC) :] or message.source != "src"):
            return ticks, ODD
        ticks.append(message.tick)
        at += head + length


def part(rng: random.Random) -> bytes:
    """A frame, or other bytes."""
    numbers = tuple(rng.uniform(-9.0, 9.0) for _ in range(3))
    message = Torque(torques=numbers, tick=rng.choice((0, 5, 200, 70_000)), time=7, source="src", used=(1, 2))
    good = frame(TOPIC + pack(message))
    match rng.randrange(14):
        case 0:
            return command(b"PING", rng.randbytes(rng.randint(0, 30)))
        case 1:
            return frame(TOPIC + pack(message), rng.choice((MORE, COMMAND)))
        case 2:
            return frame(rng.choice((b"pose", b"pos\0", b"other\0", b"")) + rng.randbytes(rng.randint(0, 300)))
        case 3:
            return frame(TOPIC + rng.randbytes(rng.randint(0, 300)))
        case 4:  # a length beyond what follows
            return bytes((2,)) + rng.choice((8, 1 << 20, 1 << 62, (1 << 64) - 1)).to_bytes(8, "big") + good[2:]
        case 5:
            cut = bytearray(good)
            cut[rng.randrange(len(cut))] = rng.randrange(256)
            return bytes(cut)
        case 6:
            return good[: rng.randrange(len(good))]
        case 7:
            return rng.randbytes(rng.randint(1, 40))
        case 8:  # a long header of a short frame
            return b"\2" + (len(good) - 2).to_bytes(8, "big") + good[2:]
        case 9:
            return frame(TOPIC + msgspec.msgpack.encode(msgspec.msgpack.decode(pack(message)) | {"more": "x" * 250}))
        case _:
            return good


@pytest.mark.parametrize("count", [2000, pytest.param(60_000, marks=pytest.mark.long)])
def test_any_bytes_in_any_pieces_are_read_as_the_protocol_says(count):
    rng, stream, states = random.Random(count), Stream(), {CUT: 0, ODD: 0}
    for _ in range(count):
        data = b"".join(part(rng) for _ in range(rng.randint(1, 12)))
        room = rng.choice((300, 1000, 8000))
        cuts = sorted(rng.randrange(len(data)) for _ in range(rng.choice((0, 0, 1, 5)))) if data else []
        near, far = socket.socketpair()
        with near, far:
            stream.begin(far.fileno(), room)
            ticks: list[int] = []
            state = CUT
            for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
                near.send(data[begin:end])
                more, state = stream.read()
                ticks += more
                if state == ODD:
                    break
        assert (ticks, state) == expected(data, room, len(ticks)), (data, room, cuts)
        states[state] += 1
    assert min(states.values()) > 0.03 * count
