"""A checked graph as data: nodes, edges and chosen effects."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from palpate.engine.faults import NOWHERE, Location
from palpate.messages import Message
from palpate.nodes.base import Node, Observer, Port, inputs, outputs


@dataclass(frozen=True)
class Edge:
    """One connected input of one node.

    port      name of the input
    producer  name of the sending node
    stream    "node", or "node.Message" if the node has several outputs
    loop      closes a loop, or feeds a source: carries the message of the latest tick before this one
    """

    port: str
    producer: str
    stream: str
    loop: bool


C = TypeVar("C")


def places(cls: type[Node], connected: Sequence[C]) -> list[tuple[Port, C | None]]:
    """The inputs of a node in the order of the header's `used`, each with its connection (an `Edge`, or anything else
    with a `port`), or None. A port that takes many senders appears once per sender."""
    found: list[tuple[Port, C | None]] = []
    for port in inputs(cls):
        edges = [(port, each) for each in connected if each.port == port.name]  # type: ignore[attr-defined]
        found += edges or ([] if port.many else [(port, None)])
    return found


@dataclass(frozen=True)
class EffectChoice:
    """Whether the user switched an effect on or off, and where."""

    on: bool
    place: Location

    @property
    def word(self) -> str:
        return "on" if self.on else "off"


@dataclass
class NodeSpec:
    """One node of a graph.

    use       name of the class as written
    settings  all settings as plain data in SI units
    every     divisor: the node runs at the ticks that this divides
    restart   whether the launcher restarts the node after its death
    when      condition as written
    off       why the condition is false; None: the node may run
    edges     connected inputs in port order
    listen    streams that an observer requests, None: all; () for other nodes
    place     where the node is written
    """

    name: str
    use: str
    cls: type[Node]
    settings: dict[str, Any]
    every: int = 1
    restart: bool = False
    when: str | None = None
    off: str | None = None
    edges: tuple[Edge, ...] = ()
    listen: tuple[str, ...] | None = ()
    place: Location = NOWHERE

    @property
    def observer(self) -> bool:
        """Whether the node only listens to streams."""
        return issubclass(self.cls, Observer)

    @property
    def streams(self) -> dict[str, type[Message]]:
        """The streams of the node and their message types, in order."""
        return streams_of(self.name, self.cls)


@dataclass
class Graph:
    """A checked graph.

    rate     [Hz]
    wanted   streams that must be computed; None: unspecified
    effects  effects that the user switched on or off
    source   content of the graph file without the scene, after all overrides
    organ    the scene's key `organ:` and its place; None: it has none
    other_notes, value_notes  lines for the user, of `value_notes` those that depend on values of settings
    """

    path: Path
    rate: float
    scene: dict[str, Any]
    nodes: dict[str, NodeSpec]
    wanted: tuple[str, ...] | None = None
    source: dict[str, Any] = field(default_factory=dict)
    effects: dict[str, EffectChoice] = field(default_factory=dict)
    other_notes: tuple[str, ...] = field(default=(), compare=False)
    organ: tuple[Any, Location] | None = field(default=None, compare=False)
    value_notes: tuple[str, ...] = field(default=(), compare=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """Lines for the user, about values of the scene that no class reads and settings that do not fit together."""
        return (*self.other_notes, *self.value_notes)

    @property
    def streams(self) -> dict[str, type[Message]]:
        """All streams and their message types, in file order."""
        return {s: kind for node in self.nodes.values() for s, kind in node.streams.items()}


def streams_of(name: str, cls: type[Node]) -> dict[str, type[Message]]:
    """The streams that a node sends and their message types."""
    sent = sent_by(cls)
    return {name: sent[0]} if len(sent) == 1 else {f"{name}.{kind.__name__}": kind for kind in sent}


def sent_by(cls: type[Node]) -> tuple[type[Message], ...]:
    """The message types that a class sends; none for an observer."""
    return () if issubclass(cls, Observer) else outputs(cls)
