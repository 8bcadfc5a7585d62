"""Checks the path of the force through a graph: which contact presses on which body, and which controller gets it.

Three mistakes fit the message types but compute wrong forces: a contact reads a body that its load does not reach;
several contacts press on one body without a joint solution; the force of a contact reaches no controller.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from palpate.engine.faults import Faults, Location
from palpate.engine.graph import NodeSpec
from palpate.engine.parts import parts
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, DeviceState, Force, Ledger, Load, Message, Pose, Proximity, Surface
from palpate.messages.contact import Neighbour, OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base import Node, inputs, outputs
from palpate.nodes.base.carrier import Carrier


def check_divisors(nodes: dict[str, NodeSpec], wires: Iterable[Wire], faults: Faults) -> None:
    """A fault for each node between a device and a contact whose divisor differs from that of its reader.

    A contact differentiates the approach over its step. If the motion of n ticks arrives in one step, the rate in that
    step is n times too high, and zero in the steps between: the force is a sawtooth.
    """
    motion: dict[str, list[Wire]] = {}
    for wire in wires:
        if issubclass(wire.port.type, DeviceState | Pose | Proximity):
            motion.setdefault(wire.consumer, []).append(wire)
    path = [name for name, spec in nodes.items() if set(spec.streams.values()) & {Contact, Contacts}]
    found = set(path)
    for reader in path:  # grows upstream to the devices
        for wire in motion.get(reader, ()):
            sender = nodes.get(wire.producer)
            if sender is None:
                continue
            if nodes[reader].every % sender.every:
                faults.add(
                    f"has `every: {sender.every}`, but {reader!r}, which reads it on the path to the contact, has "
                    f"`every: {nodes[reader].every}`: the contact would feel the motion of several ticks in one",
                    f"`{sender.name}: {{every: 1}}`, or the same divisor for both. `every` is for nodes behind the "
                    "contact: friction, tissue, display (docs/effects.md).", sender.place, node=sender.name,
                )  # fmt: skip
            if wire.producer not in found:
                found.add(wire.producer)
                path.append(wire.producer)


TISSUE = (Load, Surface, Contact, Contacts, OrganContact, Neighbour, Support)
"""Messages by which what moves an organ moves another, or a finger on it."""
MESH = ("surface", "vertices", "position", "rotation", "file_unit", "piece", "refine", "spacing")
"""Settings of the mesh whose vertices a load names."""


def unlike_surfaces(nodes: dict[str, NodeSpec], wires: Iterable[Wire]) -> Iterator[str]:
    """A note for each body whose mesh differs from that of the node that spreads its load."""
    for wire in wires:
        if issubclass(wire.port.type, Load) and wire.producer in nodes and wire.consumer in nodes:
            both = [nodes[name].settings.items() for name in (wire.producer, wire.consumer)]
            one, other = ({key: value for key, value in given if key in MESH} for given in both)
            differ = [key for key in one if key in other and one[key] != other[key]]
            if differ and "surface" in other:  # a node without a mesh may have a setting of this name
                text = ", ".join(f"{key} {one[key]} and {other[key]}" for key in differ)
                yield (
                    f"{wire.producer} and {wire.consumer} have different surfaces ({text}), so the loads act on other "
                    "vertices than those under the finger: set it in scene.surface, for both"
                )


class ContactPaths:
    """The contacts of a graph: nodes that send Contact and read a Proximity or Surface. Carriers are skipped: their
    messages count as those of the original sender.

    classes  classes of the nodes that may run, without observers
    wires    wires of these nodes
    """

    def __init__(self, classes: dict[str, type[Node]], wires: Iterable[Wire]) -> None:
        wires = [wire for wire in wires if wire.consumer in classes and wire.producer in classes]
        crossed = {wire.consumer: wire.producer for wire in wires if issubclass(classes[wire.consumer], Carrier)}
        self.classes = {name: cls for name, cls in classes.items() if not issubclass(cls, Carrier)}
        for name in crossed:
            while crossed[name] in crossed:
                crossed[name] = crossed[crossed[name]]
        origins = ((wire, crossed.get(wire.producer, wire.producer)) for wire in wires)
        self.wires = [replace(w, producer=origin) for w, origin in origins if w.consumer in self.classes]
        self.incoming: dict[str, list[Wire]] = {}
        for wire in self.wires:
            self.incoming.setdefault(wire.consumer, []).append(wire)
        self.names = {name: None for name in self.classes if self._presses(name)}  # in the order of the file
        self._pressing: dict[str, list[str]] = {}

    def check(self, places: dict[str, Location], faults: Faults) -> None:
        """Add the faults of all contacts, bodies, controllers and energy balances."""
        wrong_body = self._check_bodies_read(faults)
        self._check_contacts_read(wrong_body, places, faults)
        self._check_controllers(places, faults)
        self._check_balances(places, faults)
        self._check_orders(faults)

    def _check_bodies_read(self, faults: Faults) -> set[str]:
        """Each contact must read the body that it presses. Returns those that read another one."""
        wrong_body = set[str]()
        for name in self.names:
            for wire in self._hears(name):
                pressed = self.pressing(wire.producer)
                if pressed and name not in pressed:
                    wrong_body.add(name)
                    faults.add(
                        f"reads the body {wire.producer!r}, on which only {_and(pressed)} presses: it "
                        "would feel the indentation of another finger",
                        f"Two fingers on one body: `{wire.producer}: {{in: {{load: [spread, spread-2]}}}}` with "
                        f"`spread-2: {{in: {{contact: {name}}}}}`, a contact.Joint for both and a contact.Share for "
                        "each (docs/many_fingers.md). Or give it a separate body.",
                        wire.place, node=name, port=wire.port.name,
                    )  # fmt: skip
        return wrong_body

    def _check_contacts_read(self, wrong_body: set[str], places: dict[str, Location], faults: Faults) -> None:
        """Each body must be read by the contacts that press on it, and several contacts need a joint solution."""
        for body in self._senders(Surface):
            self._check_joint(body, faults)
            for name in self.pressing(body):
                if (
                    not any(issubclass(p.type, Surface | Contacts) for p in inputs(self.classes[name]))
                    or name in wrong_body
                    or body in {wire.producer for wire in self._hears(name)}
                ):
                    continue
                faults.add(
                    f"gets the load of {name!r}, which does not read its Surface",
                    f"On the line of {self._solver(name)!r}: `in: {{body: {body}}}`.", places[body], node=body,
                )  # fmt: skip

    def _check_controllers(self, places: dict[str, Location], faults: Faults) -> None:
        """The force of each contact must reach a controller."""
        controllers = {name: self.pressing(name) for name in self._senders(Force)}
        controlled = set().union(*controllers.values())
        for name in self.names:
            if controlled and name not in controlled:
                faults.add(
                    f"its force reaches no controller: {_and(controllers)} reads {_and(controlled)}",
                    f"Give {name!r} a controller and a device, `in: {{contact: {name}}}`, add it to the "
                    f"others by a contact.Sum if it is the same finger, or remove it: `{name}: null`.",
                    places[name], node=name,
                )  # fmt: skip

    def _check_balances(self, places: dict[str, Location], faults: Faults) -> None:
        """An energy balance must include all contacts of its bodies."""
        for name in self._senders(Ledger):
            counted = {
                c for node in (w.producer for w in self._of(name, Contact)) for c in self.pressing(node) or [node]
            }
            bodies = [w.producer for w in self._of(name, Surface)]
            pressing = list(dict.fromkeys(contact for body in bodies for contact in self.pressing(body)))
            if pressing and counted != set(pressing):
                faults.add(
                    f"includes {_and(sorted(counted))}, but {_and(pressing)} press on {_and(bodies)}: its "
                    "energy balance would not close",
                    "All of them in one order: `in: {contact: [...], force: [...], pose: [...], friction: [...]}`. "
                    f"Or remove it: `{name}: null`.", places[name], node=name,
                )  # fmt: skip

    def place_shares(self, nodes: dict[str, NodeSpec], faults: Faults) -> None:
        """Set the `finger` of each share of a joint: the index of its proximity among the inputs of the joint.
        A fault if the joint does not solve for that finger."""
        for name in self.names:
            given = nodes[name].settings
            joint, approach = self._solver(name), self._of(name, Proximity)
            if joint == name or given.get("finger") != -1:
                continue
            if not approach:
                faults.add(
                    f"takes the contact of {joint!r}, and has no `proximity` that says of which finger",
                    f"`{name}: {{in: {{contacts: {joint}, proximity: ...}}}}`, with one of the fingers of {joint!r}.",
                    node=name, port="proximity",
                )  # fmt: skip
                continue
            known = [wire.producer for wire in self._of(joint, Proximity)]
            finger = approach[0].producer
            if finger in known:
                given["finger"] = known.index(finger)
            else:
                faults.add(
                    f"is the finger {finger!r}, but {joint!r} solves for {_and(known) or 'none'}",
                    f"`{joint}: {{in: {{proximity: [{', '.join([*known, finger])}]}}}}`, or one of its fingers here.",
                    approach[0].place, node=name, port=approach[0].port.name,
                )  # fmt: skip

    def place_driven(self, nodes: dict[str, NodeSpec]) -> None:
        """Set `driven` of each controller: whether another finger, or a prescribed motion, moves the tissue that its
        finger touches, directly or through other organs."""
        tissue = [w for w in self.wires if issubclass(w.port.type, TISSUE)]
        moving = {w.producer for w in tissue if issubclass(w.port.type, Support) and not self.incoming.get(w.producer)}
        solvers = {name: {self._solver(contact) for contact in self.pressing(name)} for name in self._senders(Force)}
        for name in self._senders(Force):
            if nodes[name].settings.get("driven") != -1:
                continue
            reached = list(solvers[name])
            for node in reached:
                ends = [(w.producer, w.consumer) for w in tissue if node in (w.producer, w.consumer)]
                reached += dict.fromkeys(end for pair in ends for end in pair if end not in reached)
            bodies = [self.classes[w.producer] for w in tissue if w.port.type is Surface and w.consumer in reached]
            couples = not bodies or any(getattr(body, "couples", True) for body in bodies)
            fingers = sum(1 for touched in solvers.values() if not touched.isdisjoint(reached))
            nodes[name].settings["driven"] = int((fingers > 1 and couples) or not moving.isdisjoint(reached))

    def _check_orders(self, faults: Faults) -> None:
        """A fault for each node with several multiple inputs whose senders belong to different fingers. Inputs of
        organs belong to none, and a contact of organs has other fingers on each side."""
        of_fingers = (w for w in self.wires if not issubclass(w.port.type, OrganContact | Neighbour))
        part = parts((wire.consumer, wire.port.name, wire.producer) for wire in of_fingers)
        for name in self.classes:
            ports: dict[str, list[Wire]] = {}
            for wire in self.incoming.get(name, ()):
                if wire.port.many and not issubclass(wire.port.type, Surface | OrganContact | Neighbour | Support):
                    ports.setdefault(wire.port.name, []).append(wire)
            if OrganContact in outputs(self.classes[name]):
                continue
            first, *others = ports.values() or [[]]
            order = [part.get(wire.producer, -1) for wire in first]
            for wires in others:
                other = [part.get(wire.producer, -1) for wire in wires]
                if len({*order, *other}) > 1 and order != other:
                    faults.add(
                        f"gets {_and(w.producer for w in wires)}, but {_and(w.producer for w in first)} at "
                        f"{first[0].port.name!r}: other fingers, or in another order",
                        "One sender of each finger in every input, in the same order.", wires[0].place, node=name,
                        port=wires[0].port.name,
                    )  # fmt: skip

    def _check_joint(self, body: str, faults: Faults) -> None:
        """A fault if several contacts press on a body and are not solved jointly, in the order of their loads. The
        loads of other organs have no contact."""
        loads = [w for w in self._of(body, Load) if self.pressing(w.producer)]
        if len(self.pressing(body)) < 2:
            return
        contacts = [name for w in loads for name in self.pressing(w.producer)]
        solvers = {self._solver(name) for name in contacts}
        joint = min(solvers)
        approaches = [w.producer for w in self._of(joint, Proximity)]
        if len(solvers) > 1 or len(contacts) != len(loads) or not self._of(contacts[0], Contacts):
            faults.add(
                f"gets the loads of {_and(contacts)}, which are not solved together",
                f"One `joint: {{use: contact.Joint, in: {{proximity: [...], body: {body}}}}}` for all, and of each "
                "finger a `{use: contact.Share, in: {contacts: joint, proximity: ...}}` with its spread "
                "(docs/many_fingers.md).", loads[0].place, node=body, port=loads[0].port.name,
            )  # fmt: skip
            return
        fingers = [w.producer for name in contacts for w in self._of(name, Proximity)]
        if fingers != approaches:
            faults.add(
                f"gets the loads of the fingers {_and(fingers)}, but {joint!r} solves for {_and(approaches)}",
                f"The same fingers in the same order: `{joint}: {{in: {{proximity: [{', '.join(fingers)}]}}}}`.",
                loads[0].place, node=body, port=loads[0].port.name,
            )  # fmt: skip

    def _of(self, name: str, kind: type[Message]) -> list[Wire]:
        return [w for w in self.incoming.get(name, ()) if issubclass(w.port.type, kind)]

    def _solver(self, contact: str) -> str:
        """The node that solves a contact: itself, or the joint that it is a share of."""
        return next((w.producer for w in self._of(contact, Contacts)), contact)

    def pressing(self, name: str) -> list[str]:
        """The contacts whose force a node gets, directly or through other nodes."""
        if name not in self._pressing:
            found = {name: None}
            queue = [name]
            for node in queue:
                if node == name or node not in self.names:
                    wires = (w for w in self.incoming.get(node, ()) if issubclass(w.port.type, Contact | Load))
                    queue += (new := dict.fromkeys(w.producer for w in wires if w.producer not in found))
                    found |= new
            self._pressing[name] = [n for n in found if n in self.names and n != name]
        return self._pressing[name]

    def bodies(self, contact: str) -> list[str]:
        """The bodies that a contact presses."""
        return [wire.producer for wire in self._hears(contact)]

    def _hears(self, contact: str) -> list[Wire]:
        return self._of(self._solver(contact), Surface)

    def _senders(self, kind: type[Message]) -> list[str]:
        return [name for name, cls in self.classes.items() if any(issubclass(m, kind) for m in outputs(cls))]

    def _presses(self, name: str) -> bool:
        cls = self.classes[name]
        near = any(issubclass(p.type, Proximity | Surface) for p in inputs(cls))
        return near and any(issubclass(m, Contact) for m in outputs(cls))


def shares_without_body(nodes: dict[str, NodeSpec], wires: Iterable[Wire]) -> Iterator[str]:
    """A note for each share of a joint that does not receive the body of its joint."""
    wires = list(wires)
    if any(issubclass(wire.port.type, Contacts) for wire in wires):
        wires = ContactPaths({name: spec.cls for name, spec in nodes.items()}, wires).wires
    bodies = {wire.consumer: wire.producer for wire in wires if issubclass(wire.port.type, Surface)}
    for wire in wires:
        body = bodies.get(wire.producer)
        if issubclass(wire.port.type, Contacts) and body is not None and bodies.get(wire.consumer) != body:
            yield (
                f"{wire.consumer} does not have the `body` of {wire.producer}: after lost messages of {body} its force "
                f"returns faster, and may push the hand: `{wire.consumer}: {{in: {{body: {body}}}}}`"
            )


def _and(names: Iterable[str]) -> str:
    return " and ".join(map(repr, names))
