"""Frames for the observers of a run in parcels of bounded length, so that the number of parcels bounds the memory of a
queue: libzmq limits its queues by number, not by length.

A parcel is a frame of the same stream, `stream  zero byte  payload`, and its payload one of

    a payload as it is
    PART  number of the frame, place of the part, count of parts  share of the payload
    SEVERAL  length and bytes of one payload, of the next, ...

Neither mark begins a msgpack value or a block. A frame of which a part was dropped is dropped as a whole: its messages
count as lost.
"""

import struct
from collections.abc import Iterable, Iterator

LONGEST = 1 << 14  # [bytes] of the payload of a parcel
PART = b"\xc1\xff\xff\xff\xff"  # a block of 2^32 - 1 messages, which no frame holds
SEVERAL = b"\xc1\xff\xff\xff\xfe"
_SHARE = struct.Struct("<QII")  # number of the frame, place of the part, count of parts
_LENGTH = struct.Struct("<I")
_NUMBERS = 1 << 64


class Packer:
    """Makes the parcels of a sender.

    together  whether short frames of a stream share a parcel. Their order remains, that of different streams does not,
              except that nothing passes a frame whose stream begins with "!"
    """

    def __init__(self, together: bool) -> None:
        self._together, self._number = together, 0
        self._waiting: dict[bytes, list[bytes]] = {}  # by the stream, with its zero byte

    def pack(self, frames: Iterable[bytes], rest: bool = True) -> Iterator[bytes]:
        """The parcels of these frames. Without `rest`, frames of a stream that share a parcel may wait for more until
        they fill one, or for a call with it."""
        for frame in frames:
            begin = frame.index(b"\0") + 1
            if self._together and frame[:1] != b"!":
                self._waiting.setdefault(frame[:begin], []).append(frame)
                continue
            yield from self._gather(0)
            yield from self._divide(frame, begin)
        yield from self._gather(0 if rest else LONGEST)

    def _gather(self, least: int) -> Iterator[bytes]:
        """The parcels of the waiting frames; the last ones of a stream still wait if they have less than `least`
        bytes."""
        waiting, self._waiting = self._waiting, {}
        for topic, frames in waiting.items():
            begin, first, length = len(topic), 0, 0
            for place, frame in enumerate(frames):
                more = _LENGTH.size + len(frame) - begin
                if place > first and length + more > LONGEST:
                    yield from self._several(topic, frames[first:place])
                    first, length = place, 0
                length += more
            if length < least:
                self._waiting[topic] = frames[first:]
            else:
                yield from self._several(topic, frames[first:])

    def _several(self, topic: bytes, frames: list[bytes]) -> Iterator[bytes]:
        begin = len(topic)
        if len(frames) == 1:
            yield from self._divide(frames[0], begin)
        else:
            yield b"".join((topic, SEVERAL, *(s for f in frames for s in (_LENGTH.pack(len(f) - begin), f[begin:]))))

    def _divide(self, frame: bytes, begin: int) -> Iterator[bytes]:
        length = len(frame) - begin
        if length <= LONGEST:
            yield frame
            return
        count = -(-length // LONGEST)
        self._number = (self._number + 1) % _NUMBERS
        for place in range(count):
            share = frame[begin + place * LONGEST : begin + (place + 1) * LONGEST]
            yield b"".join((frame[:begin], PART, _SHARE.pack(self._number, place, count), share))


class Unpacker:
    """Makes frames of the parcels that a reader receives; holds at most one unfinished frame of each stream.

    longest  [bytes] of a frame; a longer one is dropped
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._open: dict[bytes, tuple[int, int, list[bytes]]] = {}

    def unpack(self, parcel: bytes) -> list[bytes]:
        """The frames that a parcel contains or completes. A parcel that no `Packer` makes contains none."""
        begin = parcel.find(b"\0") + 1
        if parcel.startswith(PART, begin):
            return self._join(parcel[:begin], memoryview(parcel)[begin + len(PART) :])
        if parcel.startswith(SEVERAL, begin):
            return self._separate(parcel[:begin], memoryview(parcel)[begin + len(SEVERAL) :])
        return [parcel]

    def _separate(self, topic: bytes, rest: memoryview) -> list[bytes]:
        if len(rest) > LONGEST:  # so that the number of its frames is bounded
            return []
        frames, at = [], 0
        while at + _LENGTH.size <= len(rest):
            (length,) = _LENGTH.unpack_from(rest, at)
            at += _LENGTH.size + length
            frames.append(b"".join((topic, rest[at - length : at])))
        return frames if at == len(rest) else []

    def _join(self, topic: bytes, rest: memoryview) -> list[bytes]:
        number, place, count, parts = -1, 0, 0, [topic]
        known = self._open.pop(topic, None)
        if len(rest) >= _SHARE.size:
            number, place, count = _SHARE.unpack_from(rest)
        if place > 0:
            if known is None or known[:2] != (number, count) or place != len(known[2]) - 1:
                return []
            parts = known[2]
        if not place < count or count * LONGEST > self._longest + LONGEST or len(rest) > LONGEST + _SHARE.size:
            return []
        parts.append(bytes(rest[_SHARE.size :]))
        if place == count - 1:
            return [b"".join(parts)]
        self._open[topic] = number, count, parts
        return []
