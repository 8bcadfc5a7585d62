"""Differences between two runs in the messages of one node."""

import math
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.messages import Field, Message, Surface, fields
from palpate.nodes.base import inputs
from palpate.records.compare import apart
from palpate.records.player import Player


class Outputs:
    """Accumulates the differences between two runs in those numbers of a node's messages that other nodes read.

    without  nodes whose reads of the terminal law of a body do not count
    """

    def __init__(self, plan: Plan, node: str, without: set[str]) -> None:
        self.node = node
        self.shown: list[tuple[int, Field]] = []
        for index, (stream, kind) in enumerate(plan.graph.nodes[node].streams.items()):
            left: set[str] = set()
            for reader in without:
                ports = {port.name: port for port in inputs(plan.graph.nodes[reader].cls)}
                if kind is Surface:
                    left.update(*(ports[e.port].wants for e in plan.edges[reader] if e.stream == stream))
            shown = plan.wanted[stream] - left
            self.shown += [(index, f) for f in fields(kind) if f.name in shown and _is_measured(f)]
        self.squares, self.peaks, self.count = [0.0] * len(self.shown), [0.0] * len(self.shown), 0

    def values(self, player: Player | None) -> list[Any]:
        """Current values of these numbers; None for each before the first message."""
        last = player.last(self.node) if player else []
        return [_values(last[index], f) if last else None for index, f in self.shown]

    def add(self, values: list[Any], base: list[Any]) -> None:
        """Add the values of both runs in one tick."""
        self.count += 1
        for k, (value, other) in enumerate(zip(values, base, strict=True)):
            difference, size = _difference(value, other)
            self.squares[k] += difference * difference
            self.peaks[k] = max(self.peaks[k], size)

    @property
    def error(self) -> float:
        """[1] RMS error over the touch, relative to the peak, of the number with the largest error."""
        shares = [math.sqrt(s / self.count) / p for s, p in zip(self.squares, self.peaks, strict=True) if p > 0.0]
        return max(shares, default=0.0)


def _is_measured(field: Field) -> bool:
    """Whether a field is a continuous quantity, not a count, index or word."""
    if field.dtype is not None:
        return field.dtype.kind == "f"
    return field.type is float or float in getattr(field.type, "__args__", ())


def _values(message: Message | None, field: Field) -> tuple[np.ndarray, np.ndarray | None] | None:
    """Rows of numbers of a field, and the vertices of the rows if the message names them."""
    if message is None:
        return None
    values = np.array(getattr(message, field.name), dtype=float)
    nodes = getattr(message, "nodes", None)
    of_nodes = nodes is not None and values.ndim > 0 and len(values) == len(nodes)
    rows = (values[:, None] if values.ndim == 1 else values) if of_nodes else values.reshape(1, -1)
    return rows, np.array(nodes) if of_nodes else None


def _difference(value: Any, other: Any) -> tuple[float, float]:
    """Difference of two values and the size of the other: the norm of a number or vector; of vertices the RMS
    difference over those in either value, and the largest norm."""
    if other is None:
        return 0.0, 0.0
    rows, nodes = other
    size = float(np.sqrt((rows**2).sum(axis=1)).max()) if rows.size else 0.0
    if value is None:
        return size, size
    if nodes is None or value[1] is None:
        fits = value[0].shape == rows.shape
        return (float(np.linalg.norm(value[0] - rows)) if fits else size), size
    return apart(value[1], value[0], nodes, rows), size
