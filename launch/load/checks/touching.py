"""Finds the two bodies of each contact of organs (contact.Between), and checks its wiring."""

import json
from collections.abc import Iterable
from typing import Any

from palpate.engine.faults import Faults
from palpate.engine.graph import NodeSpec
from palpate.launch.load.contact_paths import MESH
from palpate.launch.load.wiring import Wire
from palpate.messages import Load
from palpate.messages.contact import SIDES, OrganContact
from palpate.nodes.base import Node, inputs, outputs


def _solves(cls: type[Node]) -> bool:
    """Whether a class is a contact of organs, without an import of its compiled code."""
    return OrganContact in outputs(cls)


def _is_side(cls: type[Node]) -> bool:
    """Whether a class sends the load of a contact of organs on one of its bodies."""
    return Load in outputs(cls) and any(port.type is OrganContact for port in inputs(cls))


def place_bodies(nodes: dict[str, NodeSpec], wires: Iterable[Wire], faults: Faults) -> None:
    """Set `bodies` of each contact of organs: class and settings of both bodies, and their surfaces.

    A fault for each side without exactly one body, or whose body cannot touch another.
    """
    wires = [wire for wire in wires if wire.producer in nodes and wire.consumer in nodes]
    _count_organs(nodes, wires, faults)
    for name, spec in nodes.items():
        if not _solves(spec.cls):
            continue
        sides = [w.consumer for w in wires if w.producer == name and issubclass(w.port.type, OrganContact)]
        sides = [side for side in sides if _is_side(nodes[side].cls)]
        found = [_side(name, which, sides, nodes, wires, faults) for which in SIDES]
        if None not in found:
            spec.settings["bodies"] = json.dumps(found, sort_keys=True)


def _count_organs(nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults) -> None:
    """Set `organ_loads` of each body: how many of its loads are those of other organs. A fault unless they are last."""
    for name, spec in nodes.items():
        loads = [w for w in wires if w.consumer == name and issubclass(w.port.type, Load)]
        organs = [_is_side(nodes[w.producer].cls) for w in loads]
        if "organ_loads" in spec.settings:
            spec.settings["organ_loads"] = sum(organs)
        if organs != sorted(organs) and not _solves(spec.cls):
            order = sorted((w.producer for w in loads), key=lambda sender: _is_side(nodes[sender].cls))
            faults.add(
                "a load of another organ is before that of a finger", f"`in: {{load: [{', '.join(order)}]}}`",
                loads[0].place, node=name, port=loads[0].port.name,
            )  # fmt: skip


def _side(
    name: str, which: str, sides: list[str], nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults
) -> dict[str, Any] | None:
    """Class, settings and surface of the body on one side; None and a fault: there is no body, or several."""
    place = nodes[name].place
    named = [side for side in sides if nodes[side].settings["side"] == which]
    if len(named) != 1:
        faults.add(
            f"has {len(named)} contact.Side with `side: {which}`, expected 1",
            f"`side-of-{which}: {{use: contact.Side, in: {{contact: {name}}}, side: {which}, with: $surface}}`",
            place, node=name,
        )  # fmt: skip
        return None
    side = named[0]
    bodies = [w.consumer for w in wires if w.producer == side and issubclass(w.port.type, Load)]
    bodies = [body for body in bodies if not _solves(nodes[body].cls)]
    if len(bodies) != 1:
        faults.add(
            f"its Load is read by {len(bodies)} bodies, expected 1",
            f"One body with `in: {{load: [..., {side}]}}`.", nodes[side].place, node=side,
        )  # fmt: skip
        return None
    body = nodes[bodies[0]]
    if not _can_touch(body):
        faults.add(
            f"{bodies[0]!r} is a {body.use}, which has no contact with other bodies",
            "deformation.ReducedFE, BeamBundle, MassSpring or Rigid.", nodes[side].place, node=side,
        )  # fmt: skip
        return None
    given = nodes[side].settings
    surface = {key: given[key] for key in MESH}
    return {"use": body.cls.__name__, "settings": dict(body.settings), "surface": surface}


def _can_touch(spec: NodeSpec) -> bool:
    """Whether a shipped class of this name has a contact with other bodies: a file may not name code to run."""
    return spec.cls.__module__.startswith("palpate.nodes.deformation.") and hasattr(spec.cls, "between")
