"""How far two runs are apart in the messages of one node."""

import math
from typing import Any

import numpy as np

from palpate.engine.plan import Plan
from palpate.messages import Field, Message, Surface, fields
from palpate.nodes.base import inputs
from palpate.records.compare import apart
from palpate.records.player import Player


class Outputs:
    """The numbers in a node's messages that somebody reads, of a body's law `without` those that these nodes read, and
    how far two runs are apart in them."""

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
            self.shown += [(index, f) for f in fields(kind) if f.name in shown and _measured(f)]
        self.squares, self.peaks, self.count = [0.0] * len(self.shown), [0.0] * len(self.shown), 0

    def seen(self, player: Player | None) -> list[Any]:
        """What others read of it now; None for each where there is nothing yet."""
        last = player.last(self.node) if player else []
        return [_values(last[index], f) if last else None for index, f in self.shown]

    def add(self, now: list[Any], base: list[Any]) -> None:
        """One tick of both."""
        self.count += 1
        for k, (own, other) in enumerate(zip(now, base, strict=True)):
            off, size = _apart(own, other)
            self.squares[k] += off * off
            self.peaks[k] = max(self.peaks[k], size)

    @property
    def error(self) -> float:
        """[1] rms over the touch of what is furthest off, over its own peak."""
        shares = [math.sqrt(s / self.count) / p for s, p in zip(self.squares, self.peaks, strict=True) if p > 0.0]
        return max(shares, default=0.0)


def _measured(field: Field) -> bool:
    """Whether it is a quantity that changes bit by bit: no count, index or word."""
    if field.dtype is not None:
        return field.dtype.kind == "f"
    return field.type is float or float in getattr(field.type, "__args__", ())


def _values(message: Message | None, field: Field) -> tuple[np.ndarray, np.ndarray | None] | None:
    """Rows of numbers, and the vertices that they are of, where the message names them."""
    if message is None:
        return None
    values = np.array(getattr(message, field.name), dtype=float)
    nodes = getattr(message, "nodes", None)
    of_nodes = nodes is not None and values.ndim > 0 and len(values) == len(nodes)
    rows = (values[:, None] if values.ndim == 1 else values) if of_nodes else values.reshape(1, -1)
    return rows, np.array(nodes) if of_nodes else None


def _apart(own: Any, other: Any) -> tuple[float, float]:
    """How far one is from another: of a number or a vector its length, of many vertices the rms of those in one of
    both; and the size of the other, of vertices the largest."""
    if other is None:
        return 0.0, 0.0
    rows, nodes = other
    size = float(np.sqrt((rows**2).sum(axis=1)).max()) if rows.size else 0.0
    if own is None:
        return size, size
    if nodes is None or own[1] is None:
        fits = own[0].shape == rows.shape
        return (float(np.linalg.norm(own[0] - rows)) if fits else size), size
    return apart(own[1], own[0], nodes, rows), size
