"""Which contact presses on which body, and whose force the controller hears.

A body takes one load and answers one terminal law. A second contact that reads it would feel the dent of the first and
leave none of its own, and a contact that no controller hears presses without a force on the hand. The messages fit, so
that only the way of the force through the graph tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from palpate.engine.faults import Faults, Location
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Force, Load, Message, Proximity, Surface
from palpate.nodes.base import Node, inputs, outputs


class Contacts:
    """The nodes that press on a body: they send Contact and hear how near it is, or how it answers.

    classes  of the nodes that may run, observers left out
    wires    of these
    """

    def __init__(self, classes: dict[str, type[Node]], wires: Iterable[Wire]) -> None:
        self.classes = classes
        self.wires = [wire for wire in wires if wire.consumer in classes and wire.producer in classes]
        self.names = [name for name in classes if self._presses(name)]

    def check(self, places: dict[str, Location], faults: Faults) -> None:
        """A fault for each contact and body that do not hear each other, and each contact that no controller hears."""
        deaf = set()
        for name in self.names:
            for wire in self._hears(name):
                pressed = self.pressing(wire.producer)
                if pressed and name not in pressed:
                    deaf.add(name)
                    faults.add(
                        f"reads the body {wire.producer!r}, which the load of {_and(pressed)} presses, not its own: it "
                        "would feel the indentation of another finger",
                        f"A body takes one contact. Give {name!r} a body and a spread of its own: "
                        f"`in: {{{wire.port.name}: {wire.producer}-2}}`, `spread-2: {{in: {{contact: {name}}}}}`, "
                        f"`{wire.producer}-2: {{in: {{load: spread-2}}}}`.",
                        wire.place, node=name, port=wire.port.name,
                    )  # fmt: skip
        for body in self._senders(Surface):
            for name in self.pressing(body):
                port = next((p.name for p in inputs(self.classes[name]) if issubclass(p.type, Surface)), None)
                if port is None or name in deaf or body in {wire.producer for wire in self._hears(name)}:
                    continue
                faults.add(
                    f"gets the load of {name!r}, which does not hear how it answers",
                    f"On the line of {name!r}: `in: {{{port}: {body}}}`.", places[body], node=body,
                )  # fmt: skip
        hearing = {name: self.pressing(name) for name in self._senders(Force)}
        heard = set().union(*hearing.values())
        for name in self.names:
            if heard and name not in heard:
                faults.add(
                    f"its force reaches no controller: {_and(hearing)} hears {_and(heard)}",
                    f"A controller takes one contact. Give {name!r} a controller and a device of its own, "
                    f"`in: {{contact: {name}}}`, or take it out: `{name}: null`.", places[name], node=name,
                )  # fmt: skip

    def pressing(self, name: str) -> list[str]:
        """The contacts whose force a node gets, through others that pass it on."""
        found = [name]
        for node in found:
            if node == name or node not in self.names:
                wires = (w for w in self.wires if w.consumer == node and issubclass(w.port.type, Contact | Load))
                found += dict.fromkeys(w.producer for w in wires if w.producer not in found)
        return [n for n in found if n in self.names and n != name]

    def _hears(self, contact: str) -> Iterator[Wire]:
        return (w for w in self.wires if w.consumer == contact and issubclass(w.port.type, Surface))

    def _senders(self, kind: type[Message]) -> list[str]:
        return [name for name, cls in self.classes.items() if any(issubclass(m, kind) for m in outputs(cls))]

    def _presses(self, name: str) -> bool:
        cls = self.classes[name]
        near = any(issubclass(p.type, Proximity | Surface) for p in inputs(cls))
        return near and any(issubclass(m, Contact) for m in outputs(cls))


def _and(names: Iterable[str]) -> str:
    return " and ".join(map(repr, names))
