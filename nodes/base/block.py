"""Messages in wire format that compiled code wrote one after the other."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from palpate.records.format.message_head import HEAD

ENTRY = np.dtype([(name, "<i8") for name in ("number", "tick", "time", "begin", "end")])
"""A message: number of its stream, tick, time [ns], begin and end of its bytes."""
MARGIN = HEAD.itemsize
"""Bytes before each message: the head of its record in a recording, whose channel the recording sets. So a block is
written as it is."""


def _never() -> bool:
    return False


class Block(NamedTuple):
    """A block of messages; its memory is overwritten after the call that receives it.

    streams  names of the streams, by number
    entries  (n,) of `ENTRY`, at least one in a block that is received
    memory   (b,) bytes; each message follows the one before after `MARGIN` bytes
    claim    whether the receiver may keep entries and memory, and write to the margins, as long as it has a reference
             to them. True for one receiver at most; the others copy what they keep
    """

    streams: Sequence[str]
    entries: np.ndarray
    memory: np.ndarray
    claim: Callable[[], bool] = _never

    def of(self, number: int) -> "Block":
        """The messages of one stream, perhaps none."""
        return self._replace(entries=self.entries[self.entries["number"] == number])

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Stream, tick and encoded bytes of each message."""
        streams, memory = self.streams, self.memory.data
        for number, tick, _, begin, end in self.entries.tolist():
            yield streams[number], tick, bytes(memory[begin:end])
