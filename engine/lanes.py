"""Many runs of one segment side by side: a lane is a copy of the segment's table and of the state of its nodes.

A lane lies in one block of memory: the table first, then for each node its record and the arrays that its kernel
writes. Arrays that no kernel writes (`CompiledNode.shared`) are shared by all lanes.
"""

import hashlib
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.engine.job import NodeJob
from palpate.engine.segment import Segment, failure, view
from palpate.engine.slot import NodeError, RecordOutput, make
from palpate.engine.table import CLOCK, LANE, TAP

LINE, PAGE = 64, 4096  # [bytes] to which parts of a block are aligned; in which images are copied
Pool = weakref.WeakValueDictionary[Any, np.ndarray]
"""Shared arrays by their content, as long as a node uses them."""


class NodeImage:
    """A node after its start, as lanes copy it.

    size   [bytes] of its part of a block
    links  (n,2) where in it an address stands, and the place in it that this is of
    shared  arrays that all lanes read

    NodeError: the node does not start with these settings.
    """

    def __init__(self, job: NodeJob, counts: Sequence[int], pool: Pool) -> None:
        self.job, self.counts = job, counts
        node = self.started()
        record, held = node._record, node._held
        private, self.shared = {}, list[np.ndarray]()
        for path, array in held.items():
            if any(f"{path}.".startswith(f"{name}.") for name in node.shared):
                key = array.dtype.str, array.shape, hashlib.blake2b(array).digest()
                same = pool.setdefault(key, array)
                self.shared.append(same)
                record.view(np.int64)[_offset(record.dtype, path) // 8] = _address(same)
            else:
                private[path] = array
        spans = _spans([array for array in private.values() if array.nbytes])
        at, places = _aligned(record.nbytes), list[int]()
        for begin, end in spans:
            places.append(at)
            at += _aligned(end - begin)
        self.size = at
        image = np.zeros(-(-at // PAGE) * PAGE, np.uint8)
        image[: record.nbytes] = record.view(np.uint8)
        for place, (begin, end) in zip(places, spans, strict=True):
            image[place : place + end - begin] = view(begin, np.dtype(np.uint8), end - begin)
        self.links = np.zeros((0, 2), np.int64)
        if private:
            begins = np.array([begin for begin, _ in spans] or [0])
            links = []
            for path, array in private.items():
                if array.nbytes:
                    span = int(np.searchsorted(begins, _address(array), side="right")) - 1
                    links.append((_offset(record.dtype, path), places[span] + _address(array) - int(begins[span])))
            self.links = np.array(links or self.links, np.int64).reshape(-1, 2)
        # Memory of zeros takes no room before it is written to, so pages of zeros are not copied.
        used = np.flatnonzero(np.diff(image.reshape(-1, PAGE).any(axis=1), prepend=False, append=False)) * PAGE
        self.pieces = [(b, image[b : min(e, at)].copy()) for b, e in used.reshape(-1, 2).tolist()]

    def started(self) -> Any:
        """The node, started. NodeError: it does not."""
        node: Any = make(self.job)
        try:
            node.start()
            node.resize([abs(count) for count in self.counts])
        except BaseException as error:
            raise NodeError(self.job.name, "start", error) from error
        return node


class Lanes:
    """Runs side by side.

    segment  of the graph, whose nodes are at their beginning
    count    of lanes; each has to be placed before it runs
    """

    def __init__(self, segment: Segment, count: int) -> None:
        from palpate.engine.compiled_tick import run_lanes  # the compiler is slow to import
        from palpate.physics.entry_point import entry_point

        self.segment, self.count = segment, count
        self._run = entry_point(run_lanes, 0, 0, 0)
        self._lanes, self._taps = np.zeros(count, LANE), np.zeros((count, 0), TAP)
        self._lanes["every"] = 1
        self._blocks: list[np.ndarray | None] = [None] * count
        self._bases, self._nodes = np.zeros(count, np.int64), list[Sequence[NodeImage]]([()] * count)
        self._sources, self.every = np.zeros(0, np.int64), 1
        self.columns: list[np.ndarray] = []
        self._image_table()

    def _image_table(self) -> None:
        """Take down the segment's table, and where addresses stand in it.

        Its words are addresses, whole numbers below 2^32 and floating-point numbers of at least 1e-9, so that a word
        that lies in one of the arrays is the address of a place in it.
        """
        arrays = [array for array in self.segment.tables() if array.nbytes]
        own = [slot.node._record for slot in self.segment.slots]  # type: ignore[attr-defined]
        places = np.cumsum([0, *(_aligned(array.nbytes) for array in arrays)])
        image = np.zeros(int(places[-1]), np.uint8)
        for place, array in zip(places.tolist(), arrays, strict=False):
            image[place : place + array.nbytes] = array.view(np.uint8).ravel()
        words, self._image = image.view(np.int64), image
        spans = np.array([(_address(a), _address(a) + a.nbytes) for a in (*arrays, *own)])
        order = np.argsort(spans[:, 0])
        found = order[np.maximum(np.searchsorted(spans[order, 0], words, side="right") - 1, 0)]
        inside = np.flatnonzero((spans[found, 0] <= words) & (words < spans[found, 1]))
        target, deep = found[inside], words[inside] - spans[found[inside], 0]
        here = target < len(arrays)
        self._links = inside[here], places[target[here]] + deep[here]
        self._owns = inside[~here], target[~here] - len(arrays)
        self._places = {_address(array): place for place, array in zip(places.tolist(), arrays, strict=False)}
        self._clock = int(places[1])
        words[(self._clock + CLOCK.fields["failed"][1]) // 8] = -1  # type: ignore[index]

    def keep(self, fields: Sequence[tuple[RecordOutput, str]], rows: int, every: int = 1) -> None:
        """Take down these fields of messages at the ticks that `every` divides, the last `rows` of them; they are in
        `columns`, (lanes, rows, ...) each. Called before lanes are placed."""
        forms = [output.record.dtype.fields[name][:2] for output, name in fields]  # type: ignore[index]
        self.columns = [np.zeros((self.count, rows), dtype) for dtype, _ in forms]
        self._sources = np.array(
            [self._places[_address(output.record)] + at for (output, _), (_, at) in zip(fields, forms, strict=True)],
            np.int64,
        )
        self._taps = np.zeros((self.count, len(forms)), TAP)
        self._taps["size"] = [dtype.itemsize for dtype, _ in forms]
        for number, column in enumerate(self.columns):
            self._taps["column"][:, number] = _address(column) + np.arange(self.count) * column.strides[0]
        self.every = every
        self._lanes["every"], self._lanes["tapped"], self._lanes["room"] = every, len(forms), rows

    def place(self, lane: int, nodes: Sequence[NodeImage]) -> None:
        """Put a lane at its beginning, with these nodes."""
        parts = np.cumsum([len(self._image), *(_aligned(node.size) for node in nodes)])
        block = self._blocks[lane] = np.zeros(int(parts[-1]) + LINE, np.uint8)
        base = self._bases[lane] = -(-_address(block) // LINE) * LINE
        memory = block[base - _address(block) :][: int(parts[-1])]
        words = memory.view(np.int64)
        memory[: len(self._image)] = self._image
        at, to = self._links
        words[at] = base + to
        at, number = self._owns
        words[at] = base + parts[number]
        for part, node in zip(parts.tolist(), nodes, strict=False):
            for begin, piece in node.pieces:
                memory[part + begin : part + begin + len(piece)] = piece
            words[(part + node.links[:, 0]) // 8] = base + part + node.links[:, 1]
        self._nodes[lane] = nodes
        taps = self._taps[lane]
        taps["source"] = base + self._sources
        given = self._lanes[lane]
        given["rows"], given["clock"], given["tick"], given["taps"] = base, base + self._clock, 0, _address(taps)

    def own(self, lane: int, place: int) -> np.ndarray:
        """The record (1,) of the node at a place in the order of the segment."""
        part = len(self._image) + sum(_aligned(node.size) for node in self._nodes[lane][:place])
        return view(int(self._bases[lane]) + part, self.segment.slots[place].node._record.dtype)  # type: ignore[attr-defined]

    def run(self, first: int, count: int, ticks: int) -> None:
        """Run so many ticks of lanes; other threads run meanwhile."""
        self._run(_address(self._lanes) + first * LANE.itemsize, count, ticks)

    @property
    def ticks(self) -> np.ndarray:
        """(lanes,) The next tick of each lane; of one that failed the tick at which it did."""
        return self._lanes["tick"]

    def record(self, lane: int, output: RecordOutput) -> np.ndarray:
        """The record (1,) of an output's last message in a lane."""
        return view(int(self._bases[lane]) + self._places[_address(output.record)], output.record.dtype)

    def failure(self, lane: int) -> NodeError | None:
        """Why a lane failed; None: it did not."""
        base = int(self._bases[lane])
        place = int(view(base + self._clock, CLOCK)["failed"][0])
        if place < 0:
            return None
        node = self._nodes[lane][place].started()
        node._record[:] = self.own(lane, place)
        return failure(self.segment.slots[place], node, base, base + self._clock)

    @property
    def memory(self) -> tuple[int, int]:
        """[bytes] of all lanes, without pages that nothing was written to when they were placed, and of what they
        share."""
        images = {id(node): node for nodes in self._nodes for node in nodes}
        table = self.count * len(self._image)
        private = table + sum(len(piece) for nodes in self._nodes for node in nodes for _, piece in node.pieces)
        arrays = {_address(array): array.nbytes for node in images.values() for array in node.shared}
        return private, sum(arrays.values())


def _spans(arrays: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Begin and end of the memory of arrays, those that overlap joined."""
    joined: list[tuple[int, int]] = []
    for begin, end in sorted((_address(array), _address(array) + array.nbytes) for array in arrays):
        if joined and begin < joined[-1][1]:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    return joined


def _offset(dtype: np.dtype, path: str) -> int:
    """Where in a record the address of an array stands."""
    at = 0
    for name in path.split("."):
        dtype, offset = dtype.fields[name][:2]  # type: ignore[index]
        at += offset
    return at


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def _aligned(size: int) -> int:
    return -(-size // LINE) * LINE
