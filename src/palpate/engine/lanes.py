"""Many independent runs of one segment. A lane is a copy of the segment's table and of the state of its nodes.

Each lane is one block of memory: the table, then for each node its record and the arrays that its kernel writes. All
lanes share the arrays that no kernel writes (`CompiledNode.shared`). Lanes that run to their end one after another use
the same block.
"""

import hashlib
import weakref
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from palpate.compiler.zero_pages import PAGE, ZeroPages, written_bytes
from palpate.engine.job import NodeJob
from palpate.engine.segment import CompiledSegment, failure, view
from palpate.engine.slot import NodeError, make
from palpate.engine.table import CLOCK, LANE, TAP
from palpate.messages.record import address_of
from palpate.nodes.base import Node
from palpate.nodes.base.compiled import record

WORD, LINE = 8, 64
"""[bytes] Alignment of the arrays of a table, and of the parts of a block."""
OBJECT = 4000  # [bytes] of the objects of an image, roughly
Pool = weakref.WeakValueDictionary[Any, np.ndarray]
"""Shared arrays by their content, and by their place in memory, while a node uses them."""


class NodeImage:
    """The memory of a started node, which lanes copy.

    size    [bytes] of its part of a block;  bytes  size of the image, roughly
    links   (n,2) offset of each address in this part, and the offset to which it points
    shared  arrays that all lanes read

    NodeError: the node does not start with these settings.
    """

    def __init__(self, job: NodeJob, counts: Sequence[int], pool: Pool) -> None:
        self.job, self.counts = job, counts
        node = self.start_node()
        self.notes: list[str] = node.notes()
        """Lines for the user from the start."""
        record, held = node._record, node._held
        # Arrays that no kernel writes: point the record to the pooled array with the same content.
        private, self.shared = {}, list[np.ndarray]()
        for path, array in held.items():
            if any(f"{path}.".startswith(f"{name}.") for name in node.shared):
                self.shared.append(same := _pooled(array, pool))
                record.view(np.int64)[address_offset(record.dtype, path) // 8] = address_of(same)
            else:
                private[path] = array
        # The image: the record, then the memory of the private arrays without overlaps.
        spans = memory_spans([array for array in private.values() if array.nbytes])
        at, places = _align_size(record.nbytes), list[int]()
        for begin, end in spans:
            places.append(at)
            at += _align_size(end - begin)
        self.size = at
        image = np.zeros(-(-at // PAGE) * PAGE, np.uint8)
        image[: record.nbytes] = record.view(np.uint8)
        for place, (begin, end) in zip(places, spans, strict=True):
            image[place : place + end - begin] = view(begin, np.dtype(np.uint8), end - begin)
        # The addresses in the record, as offsets in the image.
        begins, links = [begin for begin, _ in spans], []
        for path, array in private.items():
            if array.nbytes:
                span = bisect_right(begins, address_of(array)) - 1
                links.append((address_offset(record.dtype, path), places[span] + address_of(array) - begins[span]))
        self.links = np.array(links, np.int64).reshape(-1, 2)
        # New memory is zero and takes no physical memory before it is written, so pages of zeros are not copied.
        used = np.flatnonzero(np.diff(image.reshape(-1, PAGE).any(axis=1), prepend=False, append=False)) * PAGE
        self.pieces = [(b, image[b : min(e, at)].copy()) for b, e in used.reshape(-1, 2).tolist()]
        self.bytes = OBJECT + sum(len(piece) for _, piece in self.pieces)

    @cached_property
    def reader(self) -> Any:
        """A node with these settings that has not started, which reads notes from the records of lanes."""
        node: Any = make(self.job)
        node._record = np.zeros(1, record(type(node)))
        node.own = node._record[0]
        return node

    def start_node(self) -> Any:
        """The node after its start. NodeError: the start failed."""
        node: Any = make(self.job)
        try:
            node.start()
            node.resize([abs(count) for count in self.counts])
        except BaseException as error:
            raise NodeError(self.job.name, "start", error) from error
        return node


class Lanes:
    """Independent runs of a graph.

    segment  segment of the graph, with nodes that have started and not stepped
    count    number of lanes that exist together; call `place` for each before it runs
    fields   fields of messages to record, given by their records in the segment
    columns  for each field an array (n, rows, ...) for the last `rows` values of n lanes
    every    divisor of the ticks whose values are recorded
    """

    def __init__(
        self,
        segment: CompiledSegment,
        count: int,
        fields: Sequence[tuple[np.ndarray, str]] = (),
        columns: Sequence[np.ndarray] = (),
        every: int = 1,
    ) -> None:
        from palpate.compiler.entry_point import entry_point
        from palpate.engine.compiled_tick import run_lanes  # the compiler is slow to import

        self.segment, self.count = segment, count
        self._run = entry_point(run_lanes, 0, 0, 0)
        self._lanes, self._taps = np.zeros(count, LANE), np.zeros((count, len(fields)), TAP)
        self._memory = ZeroPages()
        self._blocks: list[np.ndarray | None] = [None] * count
        self._bases, self._nodes = np.zeros(count, np.int64), list[Sequence[NodeImage]]([()] * count)
        self._parts = [np.zeros(0, np.int64)] * count
        self._image_table()
        sources = [self._places[address_of(record)] + record.dtype.fields[name][1] for record, name in fields]  # type: ignore[index]
        self._sources = np.array(sources, np.int64)
        self._taps["size"] = [record.dtype[name].itemsize for record, name in fields]
        self._lanes["every"], self._lanes["tapped"] = every, len(fields)
        self.record_in(columns)

    def record_in(self, columns: Sequence[np.ndarray]) -> None:
        """Record the lanes that are placed from now on in these arrays."""
        self.columns = list(columns)
        self._begins = np.array([address_of(column) for column in columns], np.int64)
        self._strides = np.array([column.strides[0] for column in columns], np.int64)
        self._lanes["room"] = columns[0].shape[1] if columns else 0

    def _image_table(self) -> None:
        """Copy the segment's table and find the addresses in it.

        The words of a table are addresses, integers below 2^32 and floating-point numbers of at least 1e-9, so a word
        that falls into the memory of one of the arrays is an address.
        """
        arrays = [array for array in self.segment.tables() if array.nbytes]
        records = [slot.node._record for slot in self.segment.slots]  # type: ignore[attr-defined]
        places = np.cumsum([0, *(_align_size(array.nbytes, WORD) for array in arrays)])
        image = np.zeros(_align_size(int(places[-1])), np.uint8)
        for place, array in zip(places.tolist(), arrays, strict=False):
            image[place : place + array.nbytes] = array.view(np.uint8).ravel()
        words, self._image = image.view(np.int64), image
        spans = np.array([(address_of(a), address_of(a) + a.nbytes) for a in (*arrays, *records)])
        order = np.argsort(spans[:, 0])
        found = order[np.maximum(np.searchsorted(spans[order, 0], words, side="right") - 1, 0)]
        inside = np.flatnonzero((spans[found, 0] <= words) & (words < spans[found, 1]))
        target, deep = found[inside], words[inside] - spans[found[inside], 0]
        here = target < len(arrays)
        self._links = inside[here], places[target[here]] + deep[here]
        self._owns = inside[~here], target[~here] - len(arrays)
        self._places = {address_of(array): place for place, array in zip(places.tolist(), arrays, strict=False)}
        self._clock = int(places[1])
        words[(self._clock + CLOCK.fields["failed"][1]) // 8] = -1  # type: ignore[index]

    def place(self, lane: int, nodes: Sequence[NodeImage], row: int | None = None) -> None:
        """Reset a lane to the start of the run, with these nodes. It is recorded in this row of the columns, by default
        that of its number."""
        parts, size = self._arrange(nodes)
        if (former := self._blocks[lane]) is not None:
            self._memory.give(former)
        memory = self._blocks[lane] = self._memory.take(size)
        base = self._bases[lane] = address_of(memory)
        words = memory.view(np.int64)
        memory[: len(self._image)] = self._image
        at, to = self._links
        words[at] = base + to
        at, number = self._owns
        words[at] = base + parts[number]
        for part, node in zip(parts.tolist(), nodes, strict=True):
            for begin, piece in node.pieces:
                memory[part + begin : part + begin + len(piece)] = piece
            words[(part + node.links[:, 0]) // 8] = base + part + node.links[:, 1]
        self._nodes[lane], self._parts[lane] = nodes, parts
        taps = self._taps[lane]
        taps["source"] = base + self._sources
        taps["column"] = self._begins + (lane if row is None else row) * self._strides
        given = self._lanes[lane]
        given["rows"], given["clock"], given["tick"], given["taps"] = base, base + self._clock, 0, address_of(taps)

    def _arrange(self, nodes: Sequence[NodeImage]) -> tuple[np.ndarray, int]:
        """Offset of each node in a block, and the size of the block. The largest node is the last one: few pages of it
        are written, and all others share pages."""
        sizes = np.array([node.size for node in nodes])
        order = np.argsort(sizes, kind="stable")
        ends = len(self._image) + np.cumsum([_align_size(size) for size in sizes[order].tolist()])
        parts = np.empty(len(nodes), np.int64)
        parts[order] = [len(self._image), *ends[:-1]]
        return parts, int(ends[-1])

    def own(self, lane: int, place: int) -> np.ndarray:
        """The record (1,) of the node with index `place` in the segment."""
        part = int(self._parts[lane][place])
        return view(int(self._bases[lane]) + part, self.segment.slots[place].node._record.dtype)  # type: ignore[attr-defined]

    def run(self, first: int, count: int, ticks: int) -> None:
        """Run `ticks` ticks of `count` lanes from lane `first` on, without the interpreter lock."""
        self._run(address_of(self._lanes) + first * LANE.itemsize, count, ticks)

    @property
    def ticks(self) -> np.ndarray:
        """(lanes,) The next tick of each lane, or the tick at which it failed."""
        return self._lanes["tick"]

    def record(self, lane: int, record: np.ndarray) -> np.ndarray:
        """The record (1,) in a lane of the message with this record in the segment."""
        return view(int(self._bases[lane]) + self._places[address_of(record)], record.dtype)

    def failure(self, lane: int) -> NodeError | None:
        """Cause of the failure of a lane; None: it has not failed."""
        base = int(self._bases[lane])
        place = int(view(base + self._clock, CLOCK)["failed"][0])
        if place < 0:
            return None
        node = self._nodes[lane][place].start_node()
        node._record[:] = self.own(lane, place)
        return failure(self.segment.slots[place], node, base, base + self._clock)

    def notes(self, lane: int) -> list[tuple[str, str]]:
        """Lines for the user about a lane, each with the name of its node. NodeError: a node failed to make them."""
        lines = []
        for place, image in enumerate(self._nodes[lane]):
            lines += [(image.job.name, text) for text in image.notes]
            if type(self.segment.slots[place].node).notes is not Node.notes:
                lines += [(image.job.name, text) for text in _notes(image, self.own(lane, place))]
        return lines

    @property
    def memory(self) -> tuple[int, int]:
        """Size [bytes] of the pages of all lanes that are not zero, and of the shared arrays."""
        images = {id(node): node for nodes in self._nodes for node in nodes}
        private = sum(written_bytes(block) for block in self._blocks if block is not None)
        arrays = {address_of(array): array.nbytes for node in images.values() for array in node.shared}
        return private, sum(arrays.values())


def _pooled(array: np.ndarray, pool: Pool) -> np.ndarray:
    """The pooled array with the content of this one."""
    form = array.dtype.str, array.shape
    same = pool.get((*form, address_of(array)))  # as long as it exists, no other array has its place
    if same is None:
        same = pool.setdefault((*form, hashlib.blake2b(array.data).digest()), array)
        pool[(*form, address_of(same))] = same
    return same


def _notes(image: NodeImage, own: np.ndarray) -> list[str]:
    """Lines for the user of a node with this record. NodeError: the node failed to make them."""
    try:
        return _read_notes(image.reader, own)
    except Exception:  # a custom node may read what its start has computed
        node = image.start_node()
    try:
        return _read_notes(node, own)
    except Exception as error:
        raise NodeError(image.job.name, "notes", error) from error


def _read_notes(node: Any, own: np.ndarray) -> list[str]:
    """Lines for the user of a node, with this record."""
    node._notes, node._noted = [], set()
    node._record.view(np.uint8)[:] = own.view(np.uint8)  # copies of fields would take 0.1 ms
    return list(node.notes())


def memory_spans(arrays: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Begin and end of the memory of arrays; overlapping ones are merged."""
    joined: list[tuple[int, int]] = []
    for begin, end in sorted((address_of(array), address_of(array) + array.nbytes) for array in arrays):
        if joined and begin < joined[-1][1]:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    return joined


def address_offset(dtype: np.dtype, path: str) -> int:
    """Offset of an array's address in a record; a number in the path: of several groups, the one with this index."""
    at = 0
    for name in path.split("."):
        if name.isdigit():
            dtype = dtype.base
            at += int(name) * dtype.itemsize
        else:
            dtype, offset = dtype.fields[name][:2]  # type: ignore[index]
            at += offset
    return at


def _align_size(size: int, unit: int = LINE) -> int:
    return -(-size // unit) * unit
