"""Contacts of organs that share organs on foundations (scene key `foundations`): each becomes a contact.Coupled, which
solves them all together, and gets the loads of fingers and the motions of all these organs."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from palpate.engine.faults import Faults, Location
from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Load
from palpate.messages.contact import MOST_CONTACTS, SIDES, OrganContact
from palpate.messages.record import ROOM
from palpate.nodes.base import outputs

USES = ("contact.Between", "contact.Coupled")
"""The contact that a graph names, and the one in its place."""
OF_ISLAND = ("bodies", "friction", "viscous", "bristle_stiffness", "reach", "cells", "first_organs", "second_organs")


def islands_of(contacts: Mapping[str, Sequence[str]], floating: Iterable[str]) -> list[list[str]]:
    """Groups of contacts, each with its two bodies, that share bodies that forces move (`floating`)."""
    left, groups, free = list(contacts), list[list[str]](), set(floating)
    while left:
        group = [left.pop(0)]
        for name in group:  # grows
            shared = free.intersection(contacts[name])
            group += [other for other in left if shared.intersection(contacts[other])]
            left = [other for other in left if other not in group]
        if free.intersection(contacts[group[0]]):
            groups.append([name for name in contacts if name in group])
    return groups


def check_size(island: list[str], loads: list[Any], place: Location, faults: Faults) -> None:
    """A fault for too many contacts, or loads of fingers, of organs on foundations that touch each other."""
    for found, most, what in ((len(island), MOST_CONTACTS, "contacts"), (len(loads), ROOM, "loads of fingers")):
        if found > most:
            faults.add(
                f"{found} {what} of organs on foundations that touch each other are solved together, expected at most "
                f"{most}", "Without `foundations` for one of the organs between them.", place, node=island[0],
            )  # fmt: skip


def place_islands(nodes: dict[str, NodeSpec], wires: Iterable[Wire]) -> None:
    """Set `island` of each contact.Coupled, the settings of all contacts that it solves, and its `place` in them."""
    wires = [wire for wire in wires if wire.producer in nodes and wire.consumer in nodes]
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, spec in nodes.items():
        if "island" in spec.settings and OrganContact in outputs(spec.cls):
            groups.setdefault(_senders(name, "supports", wires), []).append(name)
    for supports, island in groups.items():
        described = list(_describe(island, supports, nodes, wires))
        for place, name in enumerate(island):
            nodes[name].settings |= {"island": json.dumps(described, sort_keys=True), "place": place}


def _senders(name: str, port: str, wires: list[Wire]) -> tuple[str, ...]:
    return tuple(w.producer for w in wires if w.consumer == name and w.port.name == port)


def _describe(
    island: list[str], supports: tuple[str, ...], nodes: dict[str, NodeSpec], wires: list[Wire]
) -> Iterator[dict[str, Any]]:
    bodies: list[str] = []
    for name in island:
        loads, of_sides = _senders(name, "loads", wires), [_body(name, side, nodes, wires) for side in SIDES]
        bodies += [body for body in of_sides if body not in bodies]
        yield {
            "settings": {key: nodes[name].settings[key] for key in OF_ISLAND},
            "loads": [
                [loads.index(load) for load in _senders(name, side, wires) if load in loads] for side in SIDES
            ],
            "bodies": [bodies.index(body) for body in of_sides],
            "supports": [
                next((k for k, each in enumerate(supports) if body in nodes[each].settings["moves"]), -1)
                for body in of_sides
            ],
            "waits": all(_waits(body, name, supports, nodes, wires) for body in of_sides),
        }  # fmt: skip


def _waits(body: str, contact: str, supports: tuple[str, ...], nodes: dict[str, NodeSpec], wires: list[Wire]) -> bool:
    """Whether a body does not move without messages of a contact: it is fixed, or its foundation needs them."""
    moving = [each for each in supports if body in nodes[each].settings["moves"]]
    return not moving or any(w.producer == contact and w.consumer in moving and not w.port.optional for w in wires)


def _body(contact: str, which: str, nodes: dict[str, NodeSpec], wires: list[Wire]) -> str:
    """The body on one side of a contact; "" if it has none, which is a fault (`touching`)."""
    sides = [w.consumer for w in wires if w.producer == contact and nodes[w.consumer].settings.get("side") == which]
    return next((
        w.consumer for w in wires
        if w.producer in sides and issubclass(w.port.type, Load) and OrganContact not in outputs(nodes[w.consumer].cls)
    ), "")  # fmt: skip
