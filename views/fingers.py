"""Which streams belong to which finger, where several touch one body."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.messages import Contact, Surface
from palpate.records.stored import Stored

Finger = dict[str, str]
"""The stream of each message type, by the type's full name."""
Wire = tuple[str, str, str]
"""The node that hears, its input, and the node that sends."""


def fingers(wires: Iterable[Wire], streams: Mapping[str, tuple[str, str]]) -> list[Finger]:
    """The streams of each finger that presses on the first body, in the order of the graph.

    wires    of the nodes
    streams  sender and message type of each stream

    Fingers meet in nodes with an input that several send to: in the body, in what solves their contacts together. With
    these left out, a finger is what hangs together and has a contact. What is not of one finger alone is the same for
    all. Where one finger touches, and where nothing is known of the wires, it has the first stream of each type.
    """
    whole: Finger = {}
    for stream, (_, kind) in streams.items():
        whole.setdefault(kind, stream)
    wires = list(wires)
    count = Counter((hears, port) for hears, port, _ in wires)
    shared = {hears for (hears, _), senders in count.items() if senders > 1}
    near: dict[str, set[str]] = {producer: set() for producer, _ in streams.values() if producer not in shared}
    for hears, _, sends in wires:
        if not {hears, sends} & shared:
            near.setdefault(hears, set()).add(sends)
            near.setdefault(sends, set()).add(hears)
    contact, body = full_name(Contact), streams.get(whole.get(full_name(Surface), ""), ("", ""))[0]
    found: list[Finger] = []
    left = dict.fromkeys(producer for producer, kind in streams.values() if kind == contact and producer not in shared)
    common: Finger = {}
    for stream, (producer, kind) in streams.items():
        if producer in shared:
            common.setdefault(kind, stream)
    while left:
        part = [next(iter(left))]
        for node in part:
            part += [other for other in sorted(near[node]) if other not in part]
        for node in part:
            left.pop(node, None)
        own: Finger = {}
        for stream, (producer, kind) in streams.items():
            if producer in part:
                own.setdefault(kind, stream)
        if body in part or any(hears == body and sends in part for hears, _, sends in wires):
            found.append(common | own)
    return found if len(found) > 1 else [whole]


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
