"""Blocks of messages of one stream for observers in other processes: a frame for the messages of many ticks.

A frame is the stream's name, a zero byte, `MARK`, the number of messages, their entries (`nodes.base.block`), and their
bytes with margins. `MARK` begins no msgpack value, so a frame with one message differs. Only workers of a run on one
machine send these frames to one another; any other program receives one frame per message.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from palpate.engine.slot import Output
from palpate.nodes.base import Block
from palpate.nodes.base.block import ENTRY, MARGIN

MARK = b"\xc1"
COUNT = 4  # [bytes]
LONGEST = 1 << 16  # [bytes] of the messages in a frame


@cache
def picker() -> Any:
    """The compiled function that copies the messages of one stream, loaded or compiled."""
    from palpate.compiler.entry_point import entry_point
    from palpate.launch.run.hop.frames import pick  # the compiler is slow to import

    return entry_point(pick, 0, 0, 0, 0, 0)


def frames_of(block: Block, number: int, output: Output) -> list[bytes]:
    """The messages of one stream of a block as frames of about `LONGEST` bytes at most, so that their number bounds the
    memory of a queue; a longer message has a frame of its length."""
    entries = block.of(number).entries
    if not len(entries):
        return []
    total = np.cumsum(entries["end"] - entries["begin"])
    if total[-1] <= LONGEST:
        return [_frame(block, entries, output)]
    return [_frame(block, part, output) for part in np.split(entries, np.flatnonzero(np.diff(total // LONGEST)) + 1)]


def _frame(block: Block, entries: np.ndarray, output: Output) -> bytes:
    places = np.empty(len(entries), ENTRY)
    data = np.empty(int((entries["end"] - entries["begin"]).sum()) + len(entries) * MARGIN, np.uint8)
    picker()(entries.ctypes.data, len(entries), block.memory.ctypes.data, places.ctypes.data, data.ctypes.data)
    return b"".join((output.topic, MARK, len(entries).to_bytes(COUNT, "little"), places.tobytes(), data.tobytes()))


def block_of(stream: str, payload: bytes) -> Block | None:
    """The block in the payload of a frame; None: it is one message, or no block."""
    if payload[:1] != MARK:
        return None
    begin = 1 + COUNT
    count = int.from_bytes(payload[1:begin], "little")
    after = begin + count * ENTRY.itemsize
    if not count or len(payload) < after:
        return None
    entries, memory = np.frombuffer(payload, ENTRY, count, begin), np.frombuffer(payload, np.uint8, offset=after)
    # As `_frame` makes it: one message after the other, each after its margin.
    lengths = entries["end"] - entries["begin"]
    begins = np.cumsum(lengths + MARGIN) - lengths
    whole = (lengths >= 0).all() and (entries["begin"] == begins).all() and entries["end"][-1] == len(memory)
    return Block([stream], entries, memory) if whole and not entries["number"].any() else None
