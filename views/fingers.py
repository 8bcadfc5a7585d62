"""Which streams belong to which finger, where several touch one body."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from palpate.engine.imports import full_name
from palpate.engine.parts import Link, parts
from palpate.engine.plan import Plan
from palpate.messages import Contact, Surface
from palpate.records.stored import Stored

Finger = dict[str, str]
"""The stream of each message type, by the type's full name."""


def fingers(links: Iterable[Link], streams: Mapping[str, tuple[str, str]]) -> list[Finger]:
    """The streams of each finger that presses on the first body, in the order of the graph.

    links    between the nodes
    streams  sender and message type of each stream

    What is not of one finger alone (`engine.parts`) is the same for all. Where one finger touches, and where nothing is
    known of the links, it has the first stream of each type.
    """
    whole: Finger = {}
    for stream, (_, kind) in streams.items():
        whole.setdefault(kind, stream)
    links = list(links)
    part, contact = parts(links), full_name(Contact)
    body = streams.get(whole.get(full_name(Surface), ""), ("", ""))[0]
    on_body = {part.get(sends) for hears, _, sends in links if hears == body} | {part.get(body)}
    found = [n for n in dict.fromkeys(part.get(p) for p, kind in streams.values() if kind == contact) if n in on_body]
    if len(found) < 2 or None in found:
        return [whole]
    each: list[Finger] = []
    for number in found:
        own: Finger = {}
        for stream, (producer, kind) in streams.items():
            if part.get(producer, number) == number:
                own.setdefault(kind, stream)
        each.append(own)
    return each


def fingers_of_plan(planned: Plan) -> list[Finger]:
    """Those of a graph that runs."""
    wires = [(name, edge.port, edge.producer) for name in planned.order for edge in planned.edges[name]]
    nodes = planned.graph.nodes
    return fingers(wires, {s: (n, full_name(kind)) for n in planned.order for s, kind in nodes[n].streams.items()})


def fingers_of(recording: Stored) -> list[Finger]:
    """Those of a recording."""
    edges = recording.about.get("plan", {}).get("edges", {})
    wires = [(name, edge["port"], edge["producer"]) for name, own in edges.items() for edge in own]
    return fingers(wires, {name: (s.producer, str(s.schema["class"])) for name, s in recording.streams.items()})


def left_out(recording: Stored) -> str:
    """What no picture shows, a line for people: all but the first body. "" where there is one or none."""
    first, *others = recording.streams_of(Surface) or [""]
    if not others:
        return ""
    return f"the body {first!r} is shown, the first of {1 + len(others)}. The others: {', '.join(map(repr, others))}"
