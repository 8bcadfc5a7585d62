"""The compiled decoder against msgspec: messages and any other bytes, directly before an unreadable page."""

import ctypes
import random
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
from guarded import Form, Guarded

import palpate.messages
from palpate.compiler.entry_point import entry_point
from palpate.launch.run.hop.decode import decode
from palpate.messages import Message, MessageError, pack, unpack
from palpate.messages.record import blank, reader

SOURCE = "node"


def kinds() -> Iterator[type[Message]]:
    """The message types that a record can contain."""
    for _, kind in sorted(vars(palpate.messages).items()):
        if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message:
            try:
                blank(kind)
            except TypeError:
                continue
            yield kind


class Reader:
    """Decodes messages of one type; input, arrays and record lie directly before unreadable pages."""

    def __init__(self, kind: type[Message], room: int = 2000) -> None:
        self.kind, self._form = kind, Form(kind, SOURCE)
        self.plan, self.blank = self._form.plan, self._form.blank
        self._given, self._arena, self._record = Guarded(4), Guarded(1), Guarded(4)
        self.size, self.room = self.blank.nbytes, room // 8 * 8
        self.place = self._record.end - self.size
        self._decode = entry_point(decode, 0, 0, 0, 0, 0, 0)

    def read(self, data: bytes) -> Message | None:
        """The message, without its `used`; None: unusual."""
        begin, arena = self._given.put(data), self._arena.end - self.room
        ctypes.memset(self.place, 0, self.size)
        where = self._form.address, self.place, begin, self._given.end, arena, self.room
        if not self._decode(*where):
            return None
        made = reader(self.kind)(memoryview(ctypes.string_at(self.place, self.size)))
        msgspec.structs.force_setattr(made, "source", SOURCE)
        return made


def plain(message: Message) -> bytes:
    """The bytes of a message without its `used`, and without empty arrays where these may be omitted."""
    given = {field.name: field.default for field in msgspec.structs.fields(message)}
    empty = {
        name: default
        for name, default in given.items()
        if isinstance(default, np.ndarray) and not len(getattr(message, name))
    }
    return pack(msgspec.structs.replace(message, used=(), **empty))


def example(kind: type[Message], rng: random.Random) -> Message:
    used = tuple(rng.choice((-1, 0, 7, 130, 70_000, 1 << 33)) for _ in range(rng.randint(0, 5)))
    tick = rng.choice((0, 1, 127, 128, 255, 256, 65_536, 1 << 32, (1 << 62)))
    return msgspec.structs.replace(
        kind.example(rng.random() < 0.5), tick=tick, time=rng.randint(0, 1 << 60), source=SOURCE, used=used
    )


@pytest.mark.parametrize("kind", list(kinds()), ids=lambda kind: kind.__name__)
def test_every_message_in_our_form_is_decoded_to_the_same_bytes(kind):
    rng, read = random.Random(1), Reader(kind)
    for _ in range(50):
        message = example(kind, rng)
        found = read.read(pack(message))
        assert found is not None and plain(found) == plain(message)
        present = np.frombuffer(ctypes.string_at(read.place, read.size), read.blank.dtype)["present"][0]
        assert [bool(present >> n & 1) for n in range(len(message.used))] == [tick >= 0 for tick in message.used]


def spoilt(data: bytes, rng: random.Random) -> bytes:
    """The bytes of a message with one to three faults: cut, changed, removed, repeated, or a length made larger."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(out)) if out else 0
        match rng.randrange(6):
            case 0:
                del out[at:]
            case 1 if out:
                out[at] = rng.choice(
                    (0, 0x7F, 0x80, 0xC1, 0xC4, 0xC6, 0xCB, 0xCF, 0xDC, 0xDE, 0xFF, rng.randrange(256))
                )
            case 2:
                del out[at : at + rng.randint(1, 9)]
            case 3:
                out[at:at] = out[at : at + rng.randint(1, 40)]
            case 4:
                out[at : at + 8] = b"\xff" * 8
            case 5:
                out += rng.randbytes(rng.randint(1, 9))
    return bytes(out)


def agrees(read: Reader, data: bytes) -> bool:
    """Whether a message was decoded; if so, msgspec finds the same."""
    found = read.read(data)
    if found is None:
        return False
    try:
        expected = unpack(data, read.kind)
    except MessageError as error:
        pytest.fail(f"{read.kind.__name__}: msgspec rejects {data!r}: {error}")
    assert plain(found) == plain(expected), data
    return True


@pytest.mark.parametrize("count", [20_000, pytest.param(600_000, marks=pytest.mark.long)])
def test_damaged_messages_are_unusual_or_equal_those_of_msgspec(count):
    rng = random.Random(count)
    readers = [Reader(kind) for kind in kinds()]
    decoded = 0
    for _ in range(count):
        read = rng.choice(readers)
        decoded += agrees(read, spoilt(pack(example(read.kind, rng)), rng))
    assert 0.01 * count < decoded < 0.5 * count


def test_any_bytes_are_unusual():
    rng = random.Random(3)
    readers = [Reader(kind) for kind in kinds()]
    for _ in range(3000):
        read = rng.choice(readers)
        data = rng.randbytes(rng.randint(0, 400))
        assert not agrees(read, data)
        header = bytes(read.plan.literals[: rng.randint(0, len(read.plan.literals))])
        agrees(read, bytes((0x80 | rng.randrange(16),)) + header + data)


def test_arrays_without_room_or_with_other_shapes_are_unusual():
    (kind,) = (kind for kind in kinds() if kind.__name__ == "Load")
    message = msgspec.structs.replace(kind.example(True), tick=1, time=1, source=SOURCE)
    data = pack(message)
    assert Reader(kind).read(data) is not None
    assert Reader(kind, room=8).read(data) is None
    form = msgspec.msgpack.decode(data)
    form["forces"]["shape"] = [3, len(message.forces)]
    if form["forces"]["shape"] != [len(message.forces), 3]:
        assert Reader(kind).read(msgspec.msgpack.encode(form)) is None
