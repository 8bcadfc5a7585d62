"""A checked graph as data: its nodes, its edges, and what was said of its effects."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeVar

from palpate.engine.faults import NOWHERE, Location
from palpate.messages import Message
from palpate.nodes.base import Node, Observer, Port, inputs, outputs


@dataclass(frozen=True)
class Edge:
    """One connected input of one node.

    port      name of the input
    producer  name of the sending node
    stream    what it sends: "node", or "node.Message" where the node has several outputs
    loop      closes a loop, or feeds a source: holds the message of the latest tick before this one
    """

    port: str
    producer: str
    stream: str
    loop: bool


class _Connected(Protocol):
    @property
    def port(self) -> str: ...


C = TypeVar("C", bound=_Connected)


def places(cls: type[Node], connected: Sequence[C]) -> list[tuple[Port, C | None]]:
    """The inputs of a node as the header's `used` lists them: each port in order, None where nothing is connected; one
    that takes many has a place for each of its senders."""
    found: list[tuple[Port, C | None]] = []
    for port in inputs(cls):
        own = [(port, each) for each in connected if each.port == port.name]
        found += own or ([] if port.many else [(port, None)])
    return found


@dataclass(frozen=True)
class EffectChoice:
    """What was said of one effect, and where."""

    on: bool
    place: Location

    @property
    def word(self) -> str:
        """As it is written."""
        return "on" if self.on else "off"


@dataclass
class NodeSpec:
    """One node of a graph.

    use       the name of the class as written
    settings  all of them, plain data in SI units
    every     runs at each tick that this divides
    restart   whether it is started again when it dies
    when      its condition as written
    off       why the condition does not hold; None where the node may run
    edges     connected inputs in port order
    listen    streams that an observer asks for, None for all of them; () for other nodes
    place     where it is written
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
        """Whether it listens instead of taking part."""
        return issubclass(self.cls, Observer)

    @property
    def streams(self) -> dict[str, type[Message]]:
        """The streams that it sends and their message types, in order."""
        return streams_of(self.name, self.cls)


@dataclass
class Graph:
    """A checked graph. `rate` [Hz]; `wanted` are streams that must be computed, None where nothing is said; `effects`
    what was said of these; `source` is what the graph's file says beside the scene, with all that was set from
    outside; `notes` are lines on what of the scene no class in use takes."""

    path: Path
    rate: float
    scene: dict[str, Any]
    nodes: dict[str, NodeSpec]
    wanted: tuple[str, ...] | None = None
    source: dict[str, Any] = field(default_factory=dict)
    effects: dict[str, EffectChoice] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=(), compare=False)

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
