"""Whether a recording can be computed again: each message of each node from exactly the messages that it used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec
import numpy as np

from palpate.engine.plan import Plan
from palpate.engine.slot import NodeError
from palpate.messages import Message, MessageError, fields, pack, unpack
from palpate.messages.base import HEADER
from palpate.records.instants import instants, last_tick
from palpate.records.player import MissingInput, Player
from palpate.records.reader import Recording, RecordingError

ELSEWHERE = 1e-6
"""Relative tolerance for a recording that was computed with other versions or instructions."""


@dataclass(frozen=True)
class Difference:
    """Where a recomputed message is another one than the recorded: stream, tick, field with index, both values."""

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
    """What the check found for one node.

    checked    messages that were computed again
    differing  of these, how many came out otherwise
    first      the first difference
    largest    largest difference of a number, relative to the largest magnitude of its field so far
    stopped    why, from some place on, the node could not be checked
    """

    checked: int = 0
    differing: int = 0
    first: Difference | None = None
    largest: float = 0.0
    stopped: str = ""


@dataclass
class Report:
    """What the check found, by node. `cut` is true for a file that was cut off: its last inputs may be missing."""

    nodes: dict[str, NodeReport] = field(default_factory=dict)
    cut: bool = False

    @property
    def first(self) -> Difference | None:
        """The earliest difference; at one tick that of the node that stands first in the graph."""
        differences = [report.first for report in self.nodes.values() if report.first is not None]
        return min(differences, key=lambda difference: difference.tick, default=None)

    @property
    def ok(self) -> bool:
        """No message differs, and at least one was checked."""
        return self.first is None and any(report.checked for report in self.nodes.values())

    @property
    def complete(self) -> bool:
        """Every message of the file was checked."""
        return not any(report.stopped for report in self.nodes.values())

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {"ok": self.ok, "complete": self.complete, "cut_off": self.cut,
                "first": asdict(self.first) if self.first else None,
                "nodes": {name: asdict(report) for name, report in self.nodes.items()}}  # fmt: skip


def verify(
    recording: Recording,
    plan: Plan,
    *,
    tolerance: float = 0.0,
    show: Callable[[int, int], None] = lambda tick, last: None,
) -> Report:
    """Compute every message of every node again from the recorded messages that it names, and compare.

    tolerance  0: the bytes must be equal. Else numbers may differ by this, relative to the largest magnitude that their
               field has had in the stream so far: for another platform, whose mathematics rounds otherwise
    show       called now and then with the tick and the last tick

    RecordingError: the recording does not fit. A node that raises counts as a difference of its own.
    """
    if recording.computed:
        return recording.compute(tolerance)
    player = Player(recording, plan, plan.order, live=False)
    report = Report({part.name: NodeReport(stopped=part.broken or "") for part in player.parts if part.streams})
    present = recording.ticks()
    for part in player.parts:
        if not part.as_recorded:
            raise RecordingError(
                f"{recording.path}: a check steps every node when it was recorded, so {part.name}.every cannot be "
                "another one. Replay without --check, or leave it out."
            )
    report.cut = not recording.complete or "recovered_from" in recording.about
    for part in player.parts:
        if part.streams and not report.nodes[part.name].stopped:
            report.nodes[part.name].stopped = _cannot(recording, part.streams, part.name)
    parts = [part for part in player.parts if part.streams and not report.nodes[part.name].stopped]
    scales: dict[tuple[str, str], float] = {}
    last = last_tick(present)
    player.start()
    try:
        for tick, payloads in instants(recording, present):
            player.hear(tick, payloads)
            for part in parts:
                own = report.nodes[part.name]
                if own.stopped or part.streams[0] not in payloads:
                    continue
                try:
                    if not player.step_one(part, tick, payloads, 0):
                        own.stopped = f"from tick {tick} on: it was recorded without an input that it cannot do without"
                        continue
                except MissingInput as missing:
                    own.stopped = f"from tick {tick} on: {missing} is not in the file"
                    continue
                except NodeError as fault:
                    own.differing += 1
                    own.first = own.first or Difference(
                        part.streams[0], tick, "step", "1", "an answer", str(fault.cause)
                    )
                    own.stopped = f"from tick {tick} on: the step failed"
                    continue
                for output in part.slot.outputs:
                    payload = payloads.get(output.stream)
                    if payload is not None and output.last is not None:
                        own.checked += 1
                        compare_one(own, output.stream, payload, output.last, tolerance, scales)
            if not tick % 512:
                show(tick, last)
    finally:
        player.stop()
    return report


def _cannot(recording: Recording, streams: tuple[str, ...], name: str) -> str:
    """Why not all steps of a node can be seen in the file; empty where they can."""
    for stream in streams:
        if stream not in recording.streams:
            return f"stream {stream!r} was left out of the recording"
        if recording.streams[stream].thin > 1:
            return f"stream {stream!r} was thinned out"
        lost = recording.counts.get(stream, {}).get("lost", 0)
        if lost:
            return f"the recording lost {lost} messages of stream {stream!r}, so the node's steps are not all known"
    return ""


def compare_one(
    own: NodeReport,
    stream: str,
    payload: bytes,
    message: Message,
    tolerance: float,
    scales: dict[tuple[str, str], float],
) -> None:
    """Compare one message with its recorded bytes and note a difference. `scales`: magnitudes of the fields so far."""
    if not tolerance and pack(message) == payload:
        return
    try:
        recorded = unpack(payload, type(message))
    except MessageError as error:
        difference: Difference | None = Difference(
            stream, message.tick, "type", "1", str(error), type(message).__name__
        )
    else:
        difference = _first(own, stream, payload, recorded, message, tolerance, scales)
    if difference is not None:
        own.differing += 1
        own.first = own.first or difference


def _first(
    own: NodeReport,
    stream: str,
    payload: bytes,
    a: Message,
    b: Message,
    tolerance: float,
    scales: dict[tuple[str, str], float],
) -> Difference | None:
    """The first field that differs beyond the tolerance."""
    difference = None
    for name in HEADER:
        if getattr(a, name) != getattr(b, name):
            difference = difference or Difference(
                stream, b.tick, name, "1", repr(getattr(a, name)), repr(getattr(b, name))
            )
    for each in fields(type(b)):
        x, y = getattr(a, each.name), getattr(b, each.name)
        numeric = each.dtype is not None or bool(each.shape) or each.type is float
        if not numeric:
            if x != y:
                difference = difference or Difference(stream, b.tick, each.name, each.unit, repr(x), repr(y))
            continue
        p, q = np.asarray(x), np.asarray(y)
        if p.shape != q.shape:
            shapes = (f"shape {p.shape}", f"shape {q.shape}")
            difference = difference or Difference(stream, b.tick, each.name, each.unit, *shapes)
            continue
        if not p.size or p.tobytes() == q.tobytes():
            continue
        p, q = p.astype(float), q.astype(float)
        scale = max(scales.get((stream, each.name), 0.0), float(np.abs(p).max()), float(np.abs(q).max()))
        scales[stream, each.name] = scale
        apart = np.abs(p - q) / scale if scale else np.zeros_like(p)
        own.largest = max(own.largest, float(apart.max()))
        wrong = np.argwhere((apart > tolerance) | ((p != q) | (np.signbit(p) != np.signbit(q))) & (tolerance == 0.0))
        if len(wrong):
            index = tuple(int(i) for i in wrong[0])
            label = each.name + (f"[{', '.join(map(str, index))}]" if index else "")
            difference = difference or Difference(
                stream, b.tick, label, each.unit, repr(float(p[index])), repr(float(q[index]))
            )
    if difference is None and not tolerance:
        difference = _other_fields(stream, payload, b)
    return difference


def _other_fields(stream: str, payload: bytes, message: Message) -> Difference:
    """Equal values in other bytes: the type has got or lost a field since, or its encoding has changed."""
    before = list(msgspec.msgpack.decode(payload))
    now = list(msgspec.msgpack.decode(pack(message)))
    only = ([name for name in before if name not in now], [name for name in now if name not in before])
    differences = ["fields " + ", ".join(names) if names else "no other fields" for names in only]
    return Difference(stream, message.tick, "of the encoding", "1", *differences)
