"""Finds the two bodies of each contact of organs (contact.Between), and checks its wiring."""

import json
from collections.abc import Iterable
from typing import Any

from palpate.engine.faults import Faults
from palpate.engine.graph import NodeSpec
from palpate.launch.load.checks.graph_lines import touches_itself
from palpate.launch.load.contact_paths import MESH
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, Ledger, Load
from palpate.messages.contact import SIDES, Neighbour, OrganContact
from palpate.nodes.base import Node, inputs, outputs


def _solves(cls: type[Node]) -> bool:
    """Whether a class is a contact of organs, without an import of its compiled code."""
    return OrganContact in outputs(cls)


def _is_side(cls: type[Node]) -> bool:
    """Whether a class sends the load of a contact of organs on one of its bodies."""
    return Load in outputs(cls) and any(port.type is OrganContact for port in inputs(cls))


def place_bodies(nodes: dict[str, NodeSpec], wires: Iterable[Wire], faults: Faults) -> None:
    """Set `bodies` of each contact of organs: class and settings of both bodies, and their surfaces.

    A fault for each side without exactly one body, whose body cannot touch another, or whose fingers do not feel it.
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
            spec.settings["bodies"] = json.dumps(_of_one(name, sides, found, nodes, wires, faults), sort_keys=True)
    for name in nodes:
        loads = [w.producer for w in wires if w.consumer == name and issubclass(w.port.type, Load)]
        sides = [sender for sender in loads if _is_side(nodes[sender].cls)]
        if sides and not _solves(nodes[name].cls):
            _check_fingers(name, sides, nodes, wires, faults)
    _check_balances(nodes, wires, faults)


def _of_one(
    name: str, sides: list[str], found: list[Any], nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults
) -> list[Any]:
    """The bodies of a contact: one, if it is that of an organ with itself. A fault if it is, but not by its class, or
    the other way round."""
    spec, bodies = nodes[name], {body for side in sides for body in _bodies(side, nodes, wires)}
    alone = touches_itself(spec.cls)
    if alone == (len(bodies) == 1):
        return found[:1] if alone else found
    use = "contact.Between" if alone else "contact.Folds"
    faults.add(
        f"a {spec.use} whose sides load {_list(sorted(bodies))}, expected {'one body' if alone else 'two bodies'}",
        f"`{name}: {{use: {use}}}`, or a contact.Side of {'the same' if alone else 'another'} body.", spec.place,
        node=name,
    )  # fmt: skip
    return found


def _bodies(side: str, nodes: dict[str, NodeSpec], wires: list[Wire]) -> list[str]:
    """The bodies that bear the load of a side."""
    readers = [w.consumer for w in wires if w.producer == side and issubclass(w.port.type, Load)]
    return [reader for reader in readers if not _solves(nodes[reader].cls)]


def _count_organs(nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults) -> None:
    """Set the numbers of loads of other organs: `organ_loads` of each body, `first_organs` and `second_organs` of each
    contact of organs. A fault unless they are the last."""
    counted = {"load": "organ_loads"} | {side: f"{side}_organs" for side in SIDES}
    for name, spec in nodes.items():
        ports: dict[str, list[Wire]] = {}
        for wire in wires:
            if wire.consumer == name and issubclass(wire.port.type, Load):
                ports.setdefault(wire.port.name, []).append(wire)
        for port, loads in ports.items():
            organs = [_is_side(nodes[w.producer].cls) for w in loads]
            if counted.get(port) in spec.settings:
                spec.settings[counted[port]] = sum(organs)
            if organs != sorted(organs):
                order = sorted((w.producer for w in loads), key=lambda sender: _is_side(nodes[sender].cls))
                faults.add(
                    "a load of another organ is before that of a finger", f"`in: {{{port}: [{', '.join(order)}]}}`",
                    loads[0].place, node=name, port=port,
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
    bodies = _bodies(side, nodes, wires)
    if len(bodies) != 1:
        faults.add(
            f"its Load is read by {len(bodies)} bodies, expected 1",
            f"One body with `in: {{load: [..., {side}]}}`.", nodes[side].place, node=side,
        )  # fmt: skip
        return None
    body = nodes[bodies[0]]
    _check_loads(name, which, sides, side, bodies[0], nodes, wires, faults)
    if not _can_touch(body):
        faults.add(
            f"{bodies[0]!r} is a {body.use}, which has no contact with other bodies",
            "deformation.ReducedFE, BeamBundle, MassSpring or Rigid.", nodes[side].place, node=side,
        )  # fmt: skip
        return None
    _check_settings(bodies[0], body, faults)
    given = nodes[side].settings
    surface = {key: given[key] for key in MESH}
    return {"use": body.cls.__name__, "settings": dict(body.settings), "surface": surface}


def _check_settings(name: str, body: NodeSpec, faults: Faults) -> None:
    """A fault for each setting of a body that its contact with another one does not allow."""
    for setting, expected in getattr(body.cls, "touching", {}).items():
        if (found := body.settings[setting]) != expected:
            fault = (
                f"found {found:g} in a body that touches another one; their contact is linear, expected {expected:g}",
                f"`--set {name}.{setting}={expected:g}`, or in its tissue.", body.place,
            )  # fmt: skip
            faults.add(*fault, node=name, setting=setting)


def _check_loads(
    name: str, which: str, sides: list[str], side: str, body: str, nodes: dict[str, NodeSpec], wires: list[Wire],
    faults: Faults,
) -> None:  # fmt: skip
    """A fault unless a contact of organs gets all other loads of a body, in the order of the body; that of an organ
    with itself gets those of fingers as `first`, and those of other organs, which it may influence in turn, as
    `second`."""
    expected = [w.producer for w in wires if w.consumer == body and issubclass(w.port.type, Load)]
    if touches_itself(nodes[name].cls):
        others = [load for load in expected if load not in sides]
        first = [load for load in others if not _is_side(nodes[load].cls)] or others
        expected = first if which == SIDES[0] else [load for load in others if load not in first]
    else:
        expected.remove(side)
    found = [w.producer for w in wires if w.consumer == name and w.port.name == which]
    if found != expected:
        faults.add(
            f"gets the loads {_list(found)} of {body!r}, which bears {_list(expected)} and that of the contact",
            f"`{name}: {{in: {{{which}: {_list(expected)}}}}}`, in the order of the body.", nodes[name].place,
            node=name, port=which,
        )  # fmt: skip


def _check_fingers(body: str, sides: list[str], nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults) -> None:
    """A fault for each contact of fingers with a body that does not feel all organs that touch it, by `sides`."""
    for wire in wires:
        reader = nodes[wire.consumer]
        solves = set(outputs(reader.cls)) & {Contact, Contacts}
        if wire.producer != body or not solves or any(port.type is Contacts for port in inputs(reader.cls)):
            continue  # the share of a joint reads what that solves
        felt = [w.producer for w in wires if w.consumer == wire.consumer and issubclass(w.port.type, Neighbour)]
        if felt == sides:
            continue
        given = f"in: {{neighbour: {_list(sides)}}}"
        if any(issubclass(port.type, Neighbour) for port in inputs(reader.cls)):
            cure = f"`{wire.consumer}: {{{given}}}`, in the order of the loads of {body!r}."
        else:
            cure = f"One finger: `use: contact.Backed`, several: `use: contact.Joint`, and `{given}`."
        faults.add(
            f"a {reader.use} feels {_list(felt)} of the organs that touch {body!r}, expected {_list(sides)}", cure,
            reader.place, node=wire.consumer, port="neighbour",
        )  # fmt: skip


def _check_balances(nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults) -> None:
    """A fault for each energy balance that lacks organs which touch its body, directly or through others, or their
    contacts: energy that passes to them would count as dissipated, and as generated when it returns."""
    for name, spec in nodes.items():
        if Ledger not in outputs(spec.cls):
            continue
        given: dict[str, list[str]] = {"body": [], "others": [], "between": []}
        for wire in wires:
            if wire.consumer == name and wire.port.name in given:
                given[wire.port.name].append(wire.producer)
        organs, contacts = _touching(given["body"], nodes, wires)
        if set(given["others"]) != set(organs) or set(given["between"]) != set(contacts):
            faults.add(
                f"includes the organs {_list(given['others'])} and their contacts {_list(given['between'])}, but "
                f"{_list(contacts)} solves for {_list(organs)} next to {_list(given['body'])}: its energy balance "
                "would not close",
                f"`{name}: {{in: {{others: {_list(organs)}, between: {_list(contacts)}}}}}`. Or remove it: "
                f"`{name}: null`.", spec.place, node=name,
            )  # fmt: skip


def _touching(bodies: list[str], nodes: dict[str, NodeSpec], wires: list[Wire]) -> tuple[list[str], list[str]]:
    """The organs that touch these bodies, directly or through others, and the contacts between all of them."""
    found, contacts = list(bodies), list[str]()
    for body in found:  # grows
        sides = [w.producer for w in wires if w.consumer == body and _is_side(nodes[w.producer].cls)]
        for contact in (w.producer for w in wires if w.consumer in sides and _solves(nodes[w.producer].cls)):
            if contact in contacts:
                continue
            contacts.append(contact)
            others = [w.consumer for w in wires if w.producer == contact and _is_side(nodes[w.consumer].cls)]
            found += [
                w.consumer for w in wires
                if w.producer in others and issubclass(w.port.type, Load) and not _solves(nodes[w.consumer].cls)
                and w.consumer not in found
            ]  # fmt: skip
    return found[len(bodies) :], contacts


def _list(names: list[str]) -> str:
    return f"[{', '.join(names)}]"


def _can_touch(spec: NodeSpec) -> bool:
    """Whether a shipped class of this name has a contact with other bodies: a file may not name code to run."""
    return spec.cls.__module__.startswith("palpate.nodes.deformation.") and hasattr(spec.cls, "between")
