"""Finds the organs that one finger touches: it feels the closing of their union (nodes/base/felt/organs.py)."""

from collections.abc import Iterable

from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Load, Pose, Proximity
from palpate.nodes.base import inputs, outputs
from palpate.nodes.base.node import Port


def _adds(port: Port) -> bool:
    """Whether an input takes the contacts of one finger with several organs."""
    return port.many and issubclass(port.type, Contact)


def share_organs(nodes: dict[str, NodeSpec], wires: Iterable[Wire]) -> None:
    """Set `organs` of the collision and spread nodes of each finger whose contacts with several organs are added, and
    of the bodies that have this setting, if all of these can share a patch. Organs that move differently (`carried`)
    are touched one by one: their surface in the frame of one of them changes, and the bridges would stay where they
    were."""
    wires = [wire for wire in wires if wire.producer in nodes and wire.consumer in nodes]
    for name, spec in nodes.items():
        if Contact not in outputs(spec.cls) or not any(_adds(port) for port in inputs(spec.cls)):
            continue
        contacts = [w.producer for w in wires if w.consumer == name and _adds(w.port)]
        near = [[w.producer for w in wires if w.consumer == c and w.port.type is Proximity] for c in contacts]
        spreads = [[w.consumer for w in wires if w.producer == c and Load in outputs(nodes[w.consumer].cls)]
                   for c in contacts]  # fmt: skip
        poses = {w.producer for w in wires if w.port.type is Pose and any(w.consumer in each for each in near)}
        if (
            len(contacts) > 1
            and len(poses) == 1
            and all(
                _shares(nodes[c], near_it, after, nodes)
                for c, near_it, after in zip(contacts, near, spreads, strict=True)
            )
        ):
            bodies = [[w.consumer for w in wires if w.producer == one[0] and w.port.type is Load] for one in spreads]
            _set(nodes, [one[0] for one in near], [one[0] for one in spreads], bodies)


def _shares(contact: NodeSpec, near: list[str], spreads: list[str], nodes: dict[str, NodeSpec]) -> bool:
    """Whether a contact sends its part of a patch, of one collision to one spreading node."""
    able = getattr(contact.cls, "shares_patch", False) and len(near) == len(spreads) == 1
    return able and all("organs" in nodes[one[0]].settings for one in (near, spreads))


def _set(nodes: dict[str, NodeSpec], near: list[str], spreads: list[str], bodies: list[list[str]]) -> None:
    from palpate.nodes.base.felt.organs import organs_text  # imports the compiler

    surfaces = [nodes[name].settings for name in spreads]
    for own, (first, second, others) in enumerate(zip(near, spreads, bodies, strict=True)):
        for name in (first, second, *(each for each in others if "organs" in nodes[each].settings)):
            nodes[name].settings["organs"] = organs_text(surfaces, own)
