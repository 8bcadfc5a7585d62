"""Several fingertips on one body."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from palpate.messages import Contact, Contacts, Proximity, Surface
from palpate.nodes.base import InputError, Node, Wants, settings
from palpate.nodes.contact.series import BODY, Heard, Series
from palpate.physics.bodies.place_energy import on_hand
from palpate.physics.contact.joint import joint_step


class Joint(Series):
    """Several fingertips on one body, each in series with it as in `Series`: all forces of a step are solved together,
    so that what one presses in, the others feel at once (docs/equations/contact.md).

    The approaches stand in the order in which the body takes the loads of their fingers. All fingertips have the same
    law. Each gets its Contact by a `contact.Share`.
    """

    _count = 1  # of fingers; kept over a start

    def start(self) -> None:
        super().start()
        self._resize(self._count)
        joint_step(
            self._approach, 1e-3, self._before, self._laws, self._terminal, self._coupling, self._forces, self._solved
        )
        on_hand((0.0,) * 3, (0.0,) * 9, 0.0, (0.0, 0.0, 1.0))

    def _resize(self, count: int) -> None:
        self._count = count
        own = {name: getattr(self, name) for name in settings(Series)}
        self._fingers = [Series(**own) for _ in range(count)]
        for finger in self._fingers:
            finger.wanted = self.wanted
            finger.start()
        self._laws = np.tile(self._law, (count, 1))
        self._approach, self._before, self._forces = np.zeros(count), np.zeros(count), np.zeros(count)
        self._terminal, self._solved = np.zeros((count, 5)), np.zeros((count, 3))
        self._coupling = np.eye(count)
        self._coupling.setflags(write=False)  # as a message's, which is a type of its own to the compiler

    def step(  # type: ignore[override]
        self,
        proximity: list[Proximity],
        body: Annotated[Surface | None, Wants(*BODY.names, "laws", "slopes", "coupling")],
        *,
        dt: float,
    ) -> Contacts:
        count = len(proximity)
        if count != len(self._fingers):
            self._resize(count)
        seen: Sequence[Heard | None] = [body] * count
        if body is not None and count > 1:
            if len(body.laws) != count:
                raise InputError(body, f"found laws of {len(body.laws)} contacts, expected {count}: one a finger")
            seen = body.seen()
            self._coupling = body.coupling
        length: float | None = None
        for i, finger in enumerate(self._fingers):
            pressing = finger.pressing(proximity[i], seen[i], dt)
            if pressing is not None:
                self._approach[i], own, self._terminal[i] = pressing
                length = max(own, length or 0.0)  # after a gap the softest answer, see `Series._length`
            self._before[i] = finger.compression
        if length is not None:
            joint_step(
                self._approach, length, self._before, self._laws, self._terminal, self._coupling, self._forces,
                self._solved,
            )  # fmt: skip
        answers = [
            finger.contact(proximity[i], seen[i], None if length is None else tuple(self._solved[i].tolist()), dt)
            for i, finger in enumerate(self._fingers)
        ]
        return Contacts(
            fingers=" ".join([each.source for each in proximity]),
            force=tuple([c.force for c in answers]),
            compression=tuple([c.compression for c in answers]),
            indentation=tuple([c.indentation for c in answers]),
            compression_rate=tuple([c.compression_rate for c in answers]),
            indentation_rate=tuple([c.indentation_rate for c in answers]),
            lateral_force=np.array([c.lateral_force for c in answers]),
            stored=tuple([c.stored[0] for c in answers if c.stored]),
        )

    def notes(self) -> list[str]:
        return super().notes() + [text for finger in getattr(self, "_fingers", ()) for text in finger.notes()]

    def rests(self, proximity: list[Proximity], body: Surface | None) -> bool:  # type: ignore[override]
        if body is None or len(proximity) != len(self._fingers):
            return False
        if len(proximity) > 1 and len(body.laws) != len(proximity):
            return False
        seen: Sequence[Heard] = body.seen() if len(proximity) > 1 else [body]
        return all(f.rests(p, b) for f, p, b in zip(self._fingers, proximity, seen, strict=True))


class Share(Node):
    """The contact of one finger, of those that a `contact.Joint` has solved: the one whose approach comes from the same
    node as here."""

    def start(self) -> None:
        self._names, self._place = "", 0

    def step(self, contacts: Contacts, proximity: Proximity) -> Contact:
        if contacts.fingers != self._names:
            names = contacts.fingers.split(" ")
            if proximity.source not in names:
                raise InputError(contacts, f"found the fingers {', '.join(names)}, expected {proximity.source!r}")
            self._names, self._place = contacts.fingers, names.index(proximity.source)
        i = self._place
        return Contact(
            foot=proximity.foot,
            normal=proximity.normal,
            force=contacts.force[i],
            compression=contacts.compression[i],
            indentation=contacts.indentation[i],
            compression_rate=contacts.compression_rate[i],
            indentation_rate=contacts.indentation_rate[i],
            lateral_force=tuple(contacts.lateral_force[i].tolist()),
            stored=contacts.stored[i : i + 1],
        )
