"""The compiled reader of ZMTP frames: any bytes in any pieces, in a buffer directly before an unreadable page."""

import random
import socket

import msgspec
import pytest
from frame_stream import TOPIC, Stream

from palpate.launch.run.hop.frames import CUT, ODD
from palpate.launch.run.wire.zmtp import COMMAND, MORE, command, frame
from palpate.messages import MessageError, Torque, pack, unpack


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
