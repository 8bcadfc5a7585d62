"""The memory of started nodes, laid out in the address space of WebAssembly.

From 0 on lie the static data of the code and its stack, then from `BEGIN` on all arrays of the run: the table of the
segment, the records, the arrays of the nodes. Addresses keep their 64 bits in memory; each is moved with the array that
it points into, and a function's becomes its index in the function table.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.engine.lanes import address_offset, memory_spans
from palpate.engine.segment import CompiledSegment, view
from palpate.engine.table import ROW
from palpate.messages.record import address_of

BEGIN = 1 << 20  # [bytes] first address of the arrays
LINE = 64  # [bytes] alignment
CODE = ("compute", "idle")  # fields of a row that are addresses of machine code
LARGE = 1 << 12  # [bytes] of an array from which on it is a separate part, which variants with equal arrays share


class Part(NamedTuple):
    """Memory that is set before a run; all other memory is zero.

    at    its address;  data  its bytes
    """

    at: int
    data: bytes


class MemoryImage:
    """The memory of a segment whose nodes have started.

    segment    has not run
    functions  index in the function table of each kernel and law, by the address of its machine code
    more       other arrays of the host
    parts      what is set;  size  first address after all arrays
    """

    def __init__(self, segment: CompiledSegment, functions: Mapping[int, int], more: Sequence[np.ndarray] = ()) -> None:
        nodes = [slot.node for slot in segment.slots]
        tables = [array for array in segment.tables() if array.nbytes]
        records = [node._record for node in nodes]  # type: ignore[attr-defined]
        held = [array for node in nodes for array in node._held.values()]  # type: ignore[attr-defined]
        others = [*held, *segment.constants(), *more]
        calling = [words for node in nodes for words in calling_words(node, functions)]
        begins = {address_of(words) for words in calling}  # of arrays that variants share by their content only
        small, large = (
            [a for a in others if (a.nbytes >= LARGE and address_of(a) not in begins) == big] for big in (False, True)
        )
        self._place(tables + records + small, large, segment.buffers())
        words = self._image.view(np.int64)
        for array in tables:
            self._move_words(words, array)
        for node, record in zip(nodes, records, strict=True):
            for path, array in node._held.items():  # type: ignore[attr-defined]
                at = self.address(address_of(record)) + address_offset(record.dtype, path)
                words[(at - BEGIN) // 8] = self.address(address_of(array)) if array.nbytes else 0
        for array in calling:
            first = (self.address(address_of(array)) - BEGIN) // 8
            own = words[first : first + array.size]
            for n in np.flatnonzero(np.isin(own, list(functions))).tolist():
                own[n] = functions[int(own[n])]
        rows = words[(self.address(address_of(tables[0])) - BEGIN) // 8 :]
        for place in (row * ROW.itemsize + ROW.fields[name][1] for row in range(len(nodes)) for name in CODE):  # type: ignore[index]
            if rows[place // 8]:
                rows[place // 8] = functions[int(rows[place // 8])]
        self.parts = [Part(BEGIN, self._image.tobytes()), *self._large]

    def address(self, native: int) -> int:
        """Where an address of this process is. KeyError: in none of the arrays."""
        place = bisect_right(self._begins, native) - 1
        if place < 0 or native > self._spans[place][1]:
            raise KeyError(hex(native))
        return self._places[place] + native - self._begins[place]

    def _place(self, own: list[np.ndarray], large: list[np.ndarray], buffers: list[np.ndarray]) -> None:
        """Choose the places of all arrays: those of `own` together, each large one alone, and last the buffers, which
        begin as zeros."""
        groups = [_in_order(group) for group in (own, large, buffers)]
        placed, at, ends = list[tuple[tuple[int, int], int]](), BEGIN, list[int]()
        for spans in groups:
            for span in spans:
                placed.append((span, at))
                at += _aligned(span[1] - span[0])
            ends.append(at)
        self.size = at
        self._image = np.zeros(ends[0] - BEGIN, np.uint8)
        for (begin, end), place in placed[: len(groups[0])]:
            self._image[place - BEGIN : place - BEGIN + end - begin] = _bytes(begin, end)
        alone = ((place, _bytes(*span)) for span, place in placed[len(groups[0]) : len(groups[0]) + len(groups[1])])
        self._large = [Part(place, data.tobytes()) for place, data in alone if data.any()]
        placed.sort()
        self._spans = [span for span, _ in placed]
        self._begins = [begin for begin, _ in self._spans]
        self._places = [place for _, place in placed]

    def _move_words(self, words: np.ndarray, table: np.ndarray) -> None:
        """Move the addresses in an array of the table: its words are addresses, integers below 2^32, and
        floating-point numbers of at least 1e-9, so a word that falls into the memory of an array is an address."""
        first = (self.address(address_of(table)) - BEGIN) // 8
        own = words[first : first + table.nbytes // 8]
        for n in np.flatnonzero((own >= self._begins[0]) & (own <= self._spans[-1][1])).tolist():
            try:
                own[n] = self.address(int(own[n]))
            except KeyError:
                continue


def calling_words(node: Any, functions: Collection[int]) -> list[np.ndarray]:
    """The arrays of integers and records of a node, as words, that contain addresses of these functions."""
    arrays = (node._record, *node._held.values())
    words = [a.ravel().view(np.int64) for a in arrays if a.nbytes % 8 == 0 and (a.dtype == np.int64 or a.dtype.names)]
    return [each for each in words if np.isin(each, list(functions)).any()]


def _in_order(arrays: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Begin and end of the memory of arrays, in their order, so that equal nodes have equal images; overlapping ones
    are merged."""
    spans = memory_spans(arrays)
    own = (bisect_right(spans, (address_of(array), 1 << 64)) - 1 for array in arrays if array.nbytes)
    return [spans[n] for n in dict.fromkeys(own)]


def _bytes(begin: int, end: int) -> np.ndarray:
    return view(begin, np.dtype(np.uint8), end - begin)


def _aligned(size: int) -> int:
    return -(-size // LINE) * LINE
