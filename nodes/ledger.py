"""The energy of a touch, and the force that is taken away where energy is made (docs/equations/controller.md)."""

from itertools import zip_longest
from typing import Annotated

import msgspec

from palpate.messages import Contact, Force, Friction, Ledger, Pose, Surface
from palpate.nodes.base import Node, Wants
from palpate.physics.contact.ledger import EnergyAccount, Moment

ZERO = (0.0, 0.0, 0.0)
PRESS = Wants("normal", "force", "compression", "indentation", "lateral_force", "stored")


class Energy(Node):
    """Energy balance of a touch: work of the hand, what fingertip, tissue and bristles hold and dissipate.

    Of several fingers on one body force, contact, pose and friction stand in the same order, and the message has their
    sums; each fingertip and friction has an account of its own.

    bound  energy that a part, or the display as a whole, may give out beyond what it had; beyond it the ledger trips
           for the rest of the run, and the controller that hears it takes the force to zero. 0: it never trips
    delay  samples between the motion that a force was computed from and the one that it works on; the controller's own
    """

    effect = "energy"

    bound: Annotated[float, "J", msgspec.Meta(ge=0)] = 0.02
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0

    def start(self) -> None:
        self._books = EnergyAccount(self.delay)
        self._tripped = False
        self._notes = []

    def generated(self, part: str) -> float:
        """Energy [J] that one part has given out and cannot have had."""
        return self._books.part(part).generated

    _tripped = False

    def condition(self) -> str:
        return "tripped" if self._tripped else ""

    def step(
        self,
        force: Annotated[list[Force], Wants("force")],
        contact: Annotated[list[Contact | None], PRESS],
        pose: Annotated[list[Pose | None], Wants("position")],
        friction: Annotated[list[Friction | None], Wants("force", "stored")],
        body: Annotated[Surface | None, Wants("stored")],
    ) -> Ledger:
        books = self._books
        moments = []
        for pushed, touch, place, rubbed in zip_longest(force, contact, pose, friction):
            if pushed is not None and touch is not None and place is not None and body is not None:
                moments.append(_moment(pushed, touch, place, rubbed, body))
        if len(moments) == len(force):
            books.book(*moments)
        else:
            books.gap()
        part, most = books.worst()
        if self.bound and most > self.bound and not self._tripped:
            self._tripped = True
            self._notes.append(
                f"the {part} generated {most * 1e3:.3g} mJ, above the bound of "
                f"{self.bound * 1e3:.3g} mJ, at {force[0].time * 1e-9:.3f} s: the force goes to zero"
            )
        work, balance = books.step
        return Ledger(
            hand=books.hand,
            controller=books.controller,
            sampling=books.sampling,
            fingertip_stored=books.stored("fingertip"),
            fingertip_dissipated=books.dissipated("fingertip"),
            tissue_stored=books.stored("tissue"),
            tissue_dissipated=books.dissipated("tissue"),
            friction_stored=books.stored("friction"),
            friction_dissipated=books.dissipated("friction"),
            work=work,
            balance=balance,
            unexplained=books.balance,
            generated=most,
            generated_by=part if most else "",
            tripped=self._tripped,
        )


def _moment(force: Force, contact: Contact, pose: Pose, friction: Friction | None, body: Surface) -> Moment:
    return Moment(
        pose.position,
        force.force,
        contact.normal,
        contact.force,
        contact.compression,
        contact.indentation,
        contact.lateral_force,
        friction.force if friction is not None else ZERO,
        (_told(contact.stored), _told(body.stored), _told(friction.stored) if friction is not None else 0.0),
    )


def _told(stored: tuple[float, ...]) -> float | None:
    """What a part says that it holds [J]; None where it says nothing."""
    return stored[0] if stored else None
