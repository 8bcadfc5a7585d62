"""Blocks of messages of one stream for observers in other processes: a frame for the messages of many ticks.

A frame is the stream's name, a zero byte, `MARK`, the number of messages, their entries (`nodes.base.block`), and their
bytes with margins. `MARK` begins no msgpack value, so a frame with one message differs. Only workers of a run on one
machine send these frames to one another; any other program receives one frame per message.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from palpate.engine.slot import Output
from palpate.launch.run.hop.table import COUNT, FRAME, MARK, STREAM
from palpate.nodes.base import Block
from palpate.nodes.base.block import ENTRY, MARGIN

LONGEST = 1 << 16  # [bytes] of the messages in a frame, so that the number of frames bounds the memory of a queue
FRAMES, ROOM = 64, 1 << 18  # frames and bytes of a block at first
_MARK = bytes([MARK])


@cache
def picker() -> Any:
    """The compiled function that copies the messages of a block to frames, loaded or compiled."""
    from palpate.compiler.entry_point import entry_point
    from palpate.launch.run.hop.pick import pick  # the compiler is slow to import

    return entry_point(pick, *10 * (0,))


class Framer:
    """Makes frames of the blocks of a segment, which sends these outputs. It keeps the memory for the next block."""

    def __init__(self, outputs: Sequence[Output]) -> None:
        self._outputs = list(outputs)
        self._topics = [np.frombuffer(output.topic, np.uint8) for output in outputs]
        self._streams = np.zeros(len(self._outputs), STREAM)
        self._streams["topic"] = [topic.ctypes.data for topic in self._topics]
        self._streams["skip"] = [len(topic) for topic in self._topics]
        self._wanted = self._streams["wanted"]
        self._extend(FRAMES, ROOM)

    def _extend(self, frames: int, room: int) -> None:
        self._frames, self._memory = np.zeros(frames, FRAME), np.zeros(room // 8, np.int64)
        self._bytes = self._memory.view(np.uint8).data
        places = (self._streams, len(self._streams)), (self._frames, frames), (self._memory, self._memory.nbytes)
        self._places = [(array.ctypes.data, count) for array, count in places]

    def frames(self, block: Block) -> list[bytes]:
        """The messages of the observed streams of a block as frames of at most `LONGEST` bytes of messages each; a
        longer message has a frame of its length."""
        self._wanted[:] = [output.observed for output in self._outputs]
        entries, memory = block.entries.ctypes.data, block.memory.ctypes.data
        while True:
            streams, frames, room = self._places
            count, size = picker()(entries, len(block.entries), memory, *streams, LONGEST, *frames, *room)
            if count <= frames[1] and size <= room[1]:
                break
            self._extend(max(2 * count, frames[1]), max(2 * size, room[1]))
        made = self._frames[:count]
        places = zip(made["begin"].tolist(), made["end"].tolist(), strict=True)
        return [bytes(self._bytes[begin:end]) for begin, end in places]


def block_of(stream: str, payload: bytes) -> Block | None:
    """The block in the payload of a frame; None: it is one message, or no block."""
    if not payload or payload[0] != MARK:
        return None
    begin = 1 + COUNT
    count = int.from_bytes(payload[1:begin], "little")
    after = begin + count * ENTRY.itemsize
    if not count or len(payload) < after:
        return None
    entries, memory = np.frombuffer(payload, ENTRY, count, begin), np.frombuffer(payload, np.uint8, offset=after)
    # As `pick` makes it: one message after the other, each after its margin.
    lengths = entries["end"] - entries["begin"]
    begins = np.cumsum(lengths + MARGIN) - lengths
    whole = (lengths >= 0).all() and (entries["begin"] == begins).all() and entries["end"][-1] == len(memory)
    return Block([stream], entries, memory) if whole and not entries["number"].any() else None


def join_blocks(frames: list[bytes]) -> list[bytes]:
    """The frames of one stream from one parcel. Blocks are joined to one, if all are blocks and their ticks ascend.

    An observer takes about the same time for a block of 8 and of 48 messages, and at 5 kHz a block has 8.
    """
    if len(frames) < 2:
        return frames
    mark = frames[0].index(b"\0") + 1
    begin = mark + 1 + COUNT
    counts, places = [], []
    for frame in frames:
        count = int.from_bytes(frame[mark + 1 : begin], "little")
        after = begin + count * ENTRY.itemsize
        if frame[mark : mark + 1] != _MARK or not count or len(frame) < after:
            return frames
        counts.append(count)
        places.append(after)
    parts = list(zip(frames, places, strict=True))
    entries = np.frombuffer(bytearray().join([frame[begin:after] for frame, after in parts]), ENTRY)
    if (np.diff(entries["tick"]) <= 0).any():  # of a restarted node: an observer takes only the later ones
        return frames
    sizes = [len(frame) - after for frame, after in parts]
    shifts = np.repeat(np.cumsum([0, *sizes[:-1]]), counts)
    entries["begin"] += shifts
    entries["end"] += shifts
    head = frames[0][:mark] + _MARK + len(entries).to_bytes(COUNT, "little")
    return [b"".join((head, entries.tobytes(), *(frame[after:] for frame, after in parts)))]
