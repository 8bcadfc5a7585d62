"""The edges: the inputs of every node, their types, and which edges close a loop."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Annotated, Any

import msgspec

from palpate.engine.faults import NOWHERE, Faults, Location, choices
from palpate.engine.graph import NodeSpec
from palpate.launch.load.classes import senders, takers
from palpate.launch.load.values.lines import BOOLEAN, fill
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Message
from palpate.messages.record import ROOM
from palpate.nodes.base import CompiledNode, Node, Port, inputs

Kinds = dict[str, dict[str, type[Message]]]  # of each node its streams and their message types


@dataclass
class Wire:
    """One edge as written, before loops are resolved; `named` is the `loop:` of the file."""

    consumer: str
    port: Port
    producer: str
    stream: str
    place: Location
    driving: bool
    held: bool
    named: bool | None


def wires_of(nodes: Mapping[str, NodeSpec]) -> Iterator[Wire]:
    """The edges between nodes of a loaded graph, in its order."""
    for name, spec in nodes.items():
        ports = {} if spec.observer else {port.name: port for port in inputs(spec.cls)}
        for edge in spec.edges:
            yield Wire(name, ports[edge.port], edge.producer, edge.stream, NOWHERE, False, edge.loop, None)


class _InputEntry(msgspec.Struct, rename={"sender": "from"}):
    """One input in the file."""

    sender: Annotated[str, msgspec.Meta(description="the name of a node")]
    loop: Annotated[bool | None, msgspec.Meta(description="true or false")] = None


def find_streams(given: str, kinds: Kinds) -> list[str]:
    """The streams that "node" or "node.Message" names; empty if it names no stream."""
    name, _, message = given.partition(".")
    return [s for s, kind in kinds.get(name, {}).items() if not message or kind.__name__ == message]


def wires(name: str, cls: type[Node], line: YamlSource, kinds: Kinds, unclear: set[str], faults: Faults) -> list[Wire]:
    """The connected inputs of a node in port order.

    kinds    streams with their types, by node
    unclear  nodes whose class is unknown because of another fault
    """
    ports, fault = inputs(cls), partial(faults.add, node=name)
    given = _mapping(cls, line, fault)
    if given is None:
        return []
    connections = []
    for index, port in enumerate(ports):
        driving, at_port = index == 0 and not cls.paced, partial(fault, port=port.name)
        value = given.get(port.name)
        if value in (None, []):
            if driving or not port.optional:
                role = ", which drives the node," if driving else ""
                text = f"input{role} has no sender; expects {port.expects}"
                at_port(text, _who(port, kinds, unclear), line.place("in"))
            continue
        several = value if isinstance(value, list) else [value]
        if not _takes(cls, port, len(several), partial(at_port, place=line.place("in", port.name))):
            continue
        # Match each sender with a stream, and decide whether its messages drive the node or are held.
        connected: set[str] = set()
        for number, one in enumerate(several):
            where = line.place("in", port.name, number)
            at_sender = partial(at_port, place=where)
            written = YamlSource(one if isinstance(one, dict) else {"from": one}, {(): where})
            if isinstance(one, bool):
                at_sender(f"found {'true' if one else 'false'}, expected the name of a node", BOOLEAN)
                continue
            read = fill(_InputEntry, written, faults, node=name, port=port.name)
            stream = None if read is None else _match(port, read.sender, kinds, unclear, at_sender)
            if read is None or stream is None:
                continue
            if stream in connected:
                at_sender(f"has the sender {read.sender!r} twice", "Name each sender once.")
                continue
            connected.add(stream)
            if read.loop and driving:
                at_sender("loop: the first input drives the node and cannot be held", "Name another edge of the loop.")
            if read.loop is False and cls.paced:
                at_sender("loop: all inputs of a source are held", "Leave `loop` out.")
            held = cls.paced or bool(read.loop and not driving)
            connections.append(Wire(name, port, stream.partition(".")[0], stream, where, driving, held, read.loop))
    return connections


def _mapping(cls: type[Node], line: YamlSource, fault: Callable[..., None]) -> dict[str, Any] | None:
    """The senders of each input, `in:`; None: it is no mapping."""
    ports, given = inputs(cls), line.data.get("in")
    names = [port.name for port in ports]
    if given is None:
        given = {}
    if not isinstance(given, dict):
        example = ", ".join(f"{port}: ..." for port in names)
        text = f"in: found {given!r}, expected a mapping of input to sender: {{{example}}}"
        fault(text, "`in: all` and lists are for observers (loggers, viewers).", line.place("in"))
        return None
    for key in given:
        if key not in names:
            text, cure = unknown(line.place("in", key), f"in: {{{key}: null}}")
            fault(text, choices(f"Inputs of {cls.__name__}", key, names) + cure, line.place("in", key), port=key)
    if not ports and not cls.paced:
        fault(f"{cls.__name__} has no input, so nothing runs it", "A source says `paced = True`.", line.place())
    return given


def _takes(cls: type[Node], port: Port, count: int, fault: Callable[..., None]) -> bool:
    """Whether an input takes this number of senders."""
    if count > 1 and not port.many:
        cure = f"Classes that take several: {', '.join(takers(port.type, cls)) or 'none'}."
        fault(f"takes one {port.type.__name__}, found {count} senders", cure)
        return False
    if count > ROOM and issubclass(cls, CompiledNode):
        fault(f"takes at most {ROOM} senders, found {count}", "")
        return False
    return True


def unknown(place: Location, without: str) -> tuple[str, str]:
    """Text and cure for a key that a class lacks; the cure removes a key that was written for another class."""
    if not place.before:
        return "unknown", ""
    return f"unknown; it belongs to the previous class of this node ({place.before})", f" To remove it: `{without}`."


def _match(port: Port, sender: str, kinds: Kinds, unclear: set[str], fault: Callable[[str, str], None]) -> str | None:
    node, _, message = sender.partition(".")
    expects = f"expects {port.type.__name__}"
    if node in unclear:
        return None
    if node not in kinds:
        cure = f"{choices('Nodes', node, [*kinds, *sorted(unclear)])} {_who(port, kinds, unclear)}".strip()
        fault(f"{expects}; there is no node {node!r}", cure)
        return None
    streams = kinds[node]
    if not streams:
        fault(f"{expects}, but {node!r} sends nothing", _who(port, kinds, unclear))
        return None
    sends = [kind.__name__ for kind in streams.values()]
    if message and message not in sends:
        fault(f"{expects}; {node!r} sends no {message!r}", choices(f"{node!r} sends", message, sends))
        return None
    named = find_streams(sender, kinds)
    right = [s for s in named if issubclass(streams[s], port.type)]
    if not right:
        what = ", ".join(streams[s].__name__ for s in named)
        fault(f"{expects}, but {sender!r} sends {what}", _who(port, kinds, unclear))
        return None
    if len(right) > 1:
        fault(f"{expects}, and {node!r} sends several", f"Write one of: {', '.join(right)}.")
    return right[0]


def _who(port: Port, kinds: Kinds, unclear: set[str]) -> str:
    kind = port.type.__name__
    if fit := [s for streams in kinds.values() for s, sent in streams.items() if issubclass(sent, port.type)]:
        return f"Nodes that send {kind}: {', '.join(fit)}."
    if unclear:
        return ""  # a node with an unknown class may send it
    return f"No node sends {kind}. Classes that do: {', '.join(senders(port.type)) or 'none'}."


def close_loops(connections: Iterable[Wire], order: list[str], faults: Faults) -> None:
    """Set `held` of each wire so that the direct edges form no loop.

    The choice depends only on the file: driving and required inputs are never held; optional inputs whose sender
    is earlier in the file stay direct before the others.
    """
    place = {name: i for i, name in enumerate(order)}

    def rank(wire: Wire) -> tuple[int, int]:
        if wire.driving:
            kind = 0
        elif not wire.port.optional or wire.named is False:
            kind = 1
        else:
            kind = 2 if place[wire.producer] < place[wire.consumer] else 3
        return kind, place[wire.consumer]

    after: dict[str, list[str]] = {name: [] for name in order}
    before: dict[str, list[str]] = {name: [] for name in order}
    direct: list[Wire] = []
    for wire in sorted((w for w in connections if not w.held), key=rank):
        path = _path(after, before, wire.consumer, wire.producer)
        if path is None:
            after[wire.producer].append(wire.consumer)
            before[wire.consumer].append(wire.producer)
            direct.append(wire)
        elif rank(wire)[0] < 2:
            _report_loop(wire, [wire.producer, *path], direct, faults)
        else:
            wire.held = True
    for wire in connections:
        if wire.held and not wire.port.optional:
            kind, without = wire.port.type.__name__, replace(wire.port, optional=True).expects
            faults.add(f"holds the message of an earlier tick, but at tick 0 there is none; {kind} is not optional",
                       f"In the class, write `{wire.port.name}: {without}`.", wire.place,
                       node=wire.consumer, port=wire.port.name)  # fmt: skip


def _path(after: dict[str, list[str]], before: dict[str, list[str]], start: str, end: str) -> list[str] | None:
    """A shortest path along direct edges, from start to end, both included.

    The search first runs from both ends in turn: without a path it ends when the smaller of the two regions is known.
    """
    ahead, behind = {start: ""}, {end: ""}
    for forward, backward in zip(_reachable_from(after, ahead), _reachable_from(before, behind), strict=False):
        if forward == end or backward == start or forward in behind or backward in ahead:
            break
    else:
        return None
    for node in _reachable_from(after, ahead):
        if node == end:
            break
    path = [end]
    while path[-1] != start:
        path.append(ahead[path[-1]])
    return path[::-1]


def _reachable_from(edges: dict[str, list[str]], found: dict[str, str]) -> Iterator[str]:
    """The nodes that edges lead to from those in `found`, breadth first, themselves included. `found` gets each of them
    with the node before it."""
    queue = list(found)
    for node in queue:
        yield node
        for follower in edges[node]:
            if follower not in found:
                found[follower] = node
                queue.append(follower)


def _report_loop(wire: Wire, nodes: list[str], direct: list[Wire], faults: Faults) -> None:
    steps = set(pairwise(nodes))
    inside = [w for w in [*direct, wire] if (w.producer, w.consumer) in steps]
    second = [f"{w.consumer}.{w.port.name} ({w.port.type.__name__} | None)" for w in inside if not w.driving]
    text = f"loop without a held edge: {' -> '.join(nodes)}"
    if wire.named is False:
        cure = "Leave out `loop: false`."
    elif second:
        cure = f"One of its inputs must be optional: {', '.join(second)}."
    else:
        cure = "Each input in it drives its node. In one of the classes, make it a later, optional argument of `step`."
    faults.add(text, cure, wire.place, node=wire.consumer, port=wire.port.name)
