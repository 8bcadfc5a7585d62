"""Messages in wire format that compiled code wrote one after the other."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

ENTRY = np.dtype([(name, "<i8") for name in ("number", "tick", "time", "begin", "end")])
"""A message: number of its stream, tick, time [ns], begin and end of its bytes."""
MARGIN = 31
"""Bytes before each message for the record header of a recording, so that a block is written as it is."""


class Block(NamedTuple):
    """A block of messages; its memory is overwritten after the call that receives it.

    streams  names of the streams, by number
    entries  (n,) of `ENTRY`, at least one in a block that is received
    memory   (b,) bytes; each message follows the one before after `MARGIN` bytes
    """

    streams: Sequence[str]
    entries: np.ndarray
    memory: np.ndarray

    def of(self, number: int) -> "Block":
        """The messages of one stream, perhaps none."""
        return Block(self.streams, self.entries[self.entries["number"] == number], self.memory)

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Stream, tick and encoded bytes of each message."""
        streams, memory = self.streams, self.memory.data
        for number, tick, _, begin, end in self.entries.tolist():
            yield streams[number], tick, bytes(memory[begin:end])
