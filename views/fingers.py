"""Assigns streams to fingers, and loads to bodies."""

from collections.abc import Iterable, Mapping

from palpate.engine.imports import full_name
from palpate.engine.parts import Link, parts
from palpate.engine.plan import Plan
from palpate.messages import Contact, Friction, Load, Proximity, Surface
from palpate.records.stored import Stored

Streams = Mapping[str, tuple[str, str]]  # sender and full type name of each stream


class Finger(dict[str, str]):
    """A finger's stream of each message type, by the type's full name.

    near  its streams of Proximity, one for each organ
    """

    def __init__(self) -> None:
        self.near: list[str] = []


def fingers(links: Iterable[Link], streams: Streams) -> list[Finger]:
    """The streams of each finger, in the order of the graph.

    links  links between the nodes

    Streams that do not belong to one finger (`engine.parts`) are shared by all. The sum of the contacts or frictions of
    one finger replaces them. A single finger, or one with unknown links, gets the first stream of each type.
    """
    # Assign each node to a finger; a node that only reads one finger belongs to it.
    links = list(links)
    part = parts(links)
    heard: dict[str, set[str]] = {}
    for hears, _, sends in links:
        heard.setdefault(hears, set()).add(sends)
    for node in heard:
        numbers = {part.get(sends) for sends in heard[node]}
        if node not in part and len(numbers) == 1 and None not in numbers:
            part[node] = numbers.pop() or 0
    # Collect the streams of each finger that touches.
    contact, near = full_name(Contact), full_name(Proximity)
    found = dict.fromkeys(part.get(p) for p, kind in streams.values() if kind == contact)
    several = len(found) > 1 and None not in found
    each: list[Finger] = []
    for number in found if several else [None]:
        own_streams = {s: given for s, given in streams.items() if not several or part.get(given[0], number) == number}
        finger = Finger()
        senders: dict[str, set[str]] = {}
        for stream, (producer, kind) in own_streams.items():
            adds_up = kind in _ADDED and bool(senders.get(kind, set()) & heard.get(producer, set()))
            if adds_up or kind not in finger:
                finger[kind] = stream
            senders.setdefault(kind, set()).add(producer)
            if kind == near:
                finger.near.append(stream)
        each.append(finger)
    return each


_ADDED = {full_name(Contact), full_name(Friction)}


def bodies(links: Iterable[Link], streams: Streams) -> tuple[list[str], dict[str, str]]:
    """The streams of all surfaces, and for each stream of loads the surface that it presses."""
    surfaces = {producer: stream for stream, (producer, kind) in streams.items() if kind == full_name(Surface)}
    pressed = {sends: surfaces[hears] for hears, _, sends in links if hears in surfaces}
    loads = {s: pressed[p] for s, (p, kind) in streams.items() if kind == full_name(Load) and p in pressed}
    return list(surfaces.values()), loads


def links_of_plan(planned: Plan) -> tuple[list[Link], Streams]:
    links = [(name, edge.port, edge.producer) for name in planned.order for edge in planned.edges[name]]
    nodes = planned.graph.nodes
    return links, {s: (n, full_name(kind)) for n in planned.order for s, kind in nodes[n].streams.items()}


def links_of(recording: Stored) -> tuple[list[Link], Streams]:
    edges = recording.about.get("plan", {}).get("edges", {})
    links = [(name, edge["port"], edge["producer"]) for name, incoming in edges.items() for edge in incoming]
    return links, {name: (s.producer, str(s.schema["class"])) for name, s in recording.streams.items()}
