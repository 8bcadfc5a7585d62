"""Compares recomputed messages with recorded ones, and reports the differences."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec
import numpy as np

from palpate.messages import Message, MessageError, fields, pack, unpack
from palpate.messages.base import HEADER

ELSEWHERE = 1e-6  # relative tolerance for recordings that were computed with other versions or instructions


@dataclass(frozen=True)
class Difference:
    """A difference of a recomputed message from the recorded one: stream, tick, field with index, both values."""

    stream: str
    tick: int
    field: str
    unit: str
    recorded: str
    computed: str

    def __str__(self) -> str:
        return (
            f"stream {self.stream!r}, tick {self.tick}, field {self.field} [{self.unit}]: "
            f"recorded {self.recorded}, computed {self.computed}"
        )


@dataclass
class NodeReport:
    """Result of the check for one node.

    checked    number of recomputed messages
    differing  number of messages that differ
    first      the first difference
    largest    largest difference of a number, relative to the largest magnitude of its field so far
    stopped    why the node was not checked, or not to the end
    gap        steps or inputs of the node that the file lacks: later messages may differ
    """

    checked: int = 0
    differing: int = 0
    first: Difference | None = None
    largest: float = 0.0
    stopped: str = ""
    gap: str = ""


@dataclass
class Report:
    """Result of the check, by node.

    cut    the file is truncated or damaged, so that the last inputs may be missing
    until  [s] time of the last tick up to which all messages were checked and agree; None: not even the first
    """

    nodes: dict[str, NodeReport] = field(default_factory=dict)
    cut: bool = False
    until: float | None = None

    @property
    def first(self) -> Difference | None:
        """The earliest difference; at one tick that of the first node in the graph."""
        differences = [report.first for report in self.nodes.values() if report.first is not None]
        return min(differences, key=lambda difference: difference.tick, default=None)

    @property
    def ok(self) -> bool:
        """No message differs, and at least one was checked."""
        return self.first is None and any(report.checked for report in self.nodes.values())

    @property
    def complete(self) -> bool:
        """Every message of the file was checked."""
        return not any(report.stopped or report.gap for report in self.nodes.values())

    @property
    def verified(self) -> bool:
        """Every message of the run was checked and agrees."""
        return self.ok and self.complete and not self.cut

    def to_spec(self) -> dict[str, Any]:
        return {"ok": self.verified, "equal": self.ok, "complete": self.complete, "cut_off": self.cut,
                "verified_until_s": self.until,
                "first": asdict(self.first) if self.first else None,
                "nodes": {name: asdict(report) for name, report in self.nodes.items()}}  # fmt: skip


class Comparer:
    """Compares messages with their recorded bytes, within a tolerance (see `verify`)."""

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self._scales: dict[tuple[str, str], float] = {}  # largest magnitude so far, by stream and field

    def compare(self, report: NodeReport, stream: str, payload: bytes, message: Message) -> None:
        """Compare one message with its recorded bytes and note a difference."""
        report.checked += 1
        if not self.tolerance and pack(message) == payload:
            return
        try:
            recorded = unpack(payload, type(message))
        except MessageError as error:
            found = [Difference(stream, message.tick, "type", "1", str(error), type(message).__name__)]
        else:
            found = list(self._differences(report, stream, recorded, message))
            if not found and not self.tolerance:
                found = [_other_fields(stream, payload, message)]
        if found:
            report.differing += 1
            report.first = report.first or found[0]

    def _differences(self, report: NodeReport, stream: str, a: Message, b: Message) -> Iterator[Difference]:
        """Differences beyond the tolerance between the recorded message (a) and the computed one (b)."""
        for name in HEADER:
            if getattr(a, name) != getattr(b, name):
                yield Difference(stream, b.tick, name, "1", repr(getattr(a, name)), repr(getattr(b, name)))
        for each in fields(type(b)):
            x, y = getattr(a, each.name), getattr(b, each.name)
            numeric = each.dtype is not None or bool(each.shape) or each.type is float
            if not numeric:
                if x != y:
                    yield Difference(stream, b.tick, each.name, each.unit, repr(x), repr(y))
                continue
            p, q = np.asarray(x), np.asarray(y)
            if p.shape != q.shape:
                yield Difference(stream, b.tick, each.name, each.unit, f"shape {p.shape}", f"shape {q.shape}")
                continue
            if not p.size or p.tobytes() == q.tobytes():
                continue
            p, q = p.astype(float), q.astype(float)
            before = self._scales.get((stream, each.name), 0.0)
            scale = self._scales[stream, each.name] = max(before, float(np.abs(p).max()), float(np.abs(q).max()))
            apart = np.abs(p - q) / scale if scale else np.zeros_like(p)
            report.largest = max(report.largest, float(apart.max()))
            wrong = apart > self.tolerance
            if not self.tolerance:
                wrong |= (p != q) | (np.signbit(p) != np.signbit(q))
            if wrong.any():
                index = tuple(int(i) for i in np.argwhere(wrong)[0])
                label = each.name + (f"[{', '.join(map(str, index))}]" if index else "")
                yield Difference(stream, b.tick, label, each.unit, repr(float(p[index])), repr(float(q[index])))


def _other_fields(stream: str, payload: bytes, message: Message) -> Difference:
    """The difference of messages with equal values but different bytes: fields were added or removed, or the encoding
    has changed."""
    before = list(msgspec.msgpack.decode(payload))
    now = list(msgspec.msgpack.decode(pack(message)))
    only = ([name for name in before if name not in now], [name for name in now if name not in before])
    differences = ["fields " + ", ".join(names) if names else "no other fields" for names in only]
    return Difference(stream, message.tick, "of the encoding", "1", *differences)
