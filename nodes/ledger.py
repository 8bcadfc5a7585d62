"""The energy balance of a touch, which stops the force if energy is generated (docs/equations/controller.md)."""

from math import nan
from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.records import array_of, floats, lend, nth, put, vector
from palpate.messages import Contact, Force, Friction, Ledger, Pose, Surface
from palpate.messages.contact import OrganContact
from palpate.messages.ledger import PARTS
from palpate.messages.record import ROOM
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out, Wants
from palpate.nodes.base.kernels import kernel
from palpate.physics.bodies.floating.turning import turned, turned_back
from palpate.physics.contact import ledger

ZERO = (0.0, 0.0, 0.0)
CONTACT = {"steps": int, "work": (), "carried": (), "past_work": (), "past_carried": (), "moves": bool}
"""Last message of a contact of organs: its number of steps, work on it and of foundations through it [J] since its
start, and before that; whether a foundation moves."""
_moments_of = array_of(ledger.MOMENT_TYPE)
PRESS = Wants("normal", "force", "compression", "indentation", "lateral_force", "stored")


@kernel
def stored_energy(stored):
    """Stored energy [J] that a part has sent; NaN if it sends none."""
    return stored.values[0] if stored.count > 0 else nan


@kernel
def of_organs(own, others, between):
    """Energy [J] stored in the other organs, NaN if one does not report it, work on all contacts of organs, energy
    stored there, and work of moving foundations through them; whether one moves.

    The works are sums since the start of the ledger: they keep what a contact did before it died or was restarted.
    What its bristles stored then is dissipated."""
    stored = given = held = carried = 0.0
    moves = False
    for i in range(others.count):
        each = nth(others, i)
        stored += stored_energy(each.stored) if each.there else nan
    for i in range(between.count):
        touch, kept = nth(between, i), own.contacts[i]
        if touch.there:
            if touch.steps < kept.steps:  # it was restarted
                kept.past_work, kept.past_carried = kept.past_work + kept.work, kept.past_carried + kept.carried
                kept.carried = 0.0
            begun, kept.steps = kept.steps == 0 and touch.steps > 1, touch.steps
            kept.work = touch.stored + touch.dissipated - touch.generated
            held += touch.stored
            if touch.carried.shape[0] > 0:
                kept.carried, kept.moves = floats(touch.carried)[0], True
            if begun:  # before the ledger: it has dissipated nothing yet
                kept.past_work, kept.past_carried = touch.stored - kept.work, -kept.carried
        given += kept.past_work + kept.work
        carried += kept.past_carried + kept.carried
        moves = moves or kept.moves
    return stored, given, held, carried, moves


@kernel
def step_of(own, support):
    """Motion [m] (3) of a foundation since the last message, its rotation before, and whether it has a new one."""
    before = vector(own.turn)
    if support.count == 0 or not nth(support, 0).there:
        return ZERO, before, False
    given = nth(support, 0)
    x, y, z = vector(own.at)
    put(own.at, vector(given.displacement))
    moved = own.at[0] - x, own.at[1] - y, own.at[2] - z
    if given.rotation.shape[0] == 0:
        return moved, before, False
    put(own.turn, vector(floats(given.rotation)))
    put(own.centre, vector(floats(given.centre)))
    return turned_back(before, moved), before, True


@kernel
def moved_at(own, place, moved, before, turns):
    """Motion [m] (3) of a foundation at a place [m] (3) of the organ, in its frame."""
    if not turns:
        return moved
    c, now = vector(own.centre), vector(own.turn)
    arm = (place[0] - c[0], place[1] - c[1], place[2] - c[2])
    to = turned_back(before, turned(now, arm))
    return moved[0] + to[0] - arm[0], moved[1] + to[1] - arm[1], moved[2] + to[2] - arm[2]


class Energy(CompiledNode):
    """Energy balance of a touch: work of the hand, energy that fingertip, tissue and bristles store and dissipate.

    For several fingers on one body, the inputs force, contact, pose and friction have the same order, and the message
    contains sums; each fingertip and each friction has a separate account. Organs that touch the body, `others`, count
    with it as one, and their contacts, `between`, as a part. If the body moves with its foundation, `support`, the
    poses are those in its frame (support.Relative), and its work is counted apart from that of the hand.

    bound  energy that a part, or the whole display, may generate. Above it the ledger trips for the rest of the run,
           and the controller reduces the force to zero. 0: the ledger never trips
    delay  samples between the motion from which a force was computed and the motion on which it acts, by the device;
           the loader sets it to the `delay` of the controller, less that of a network
    """

    effect = "energy"

    bound: Annotated[float, "J", msgspec.Meta(ge=0)] = 0.02
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0

    State = {
        "account": ledger.LEDGER, "past": TABLE,
        "at": (3,), "turn": (3,), "centre": (3,),  # [m] the foundation, [rad] its rotation, [m] about this point
        "contacts": (ROOM, CONTACT),
        "lent": (), "carried": ARRAY,  # [J] its work on the fingers, and all of it
        "tripped": bool, "by": int, "most": (), "time": int,  # row of the part that tripped it, its energy, time [ns]
    }  # fmt: skip
    conditions = {"tripped": "tripped"}

    def start(self) -> None:
        super().start()
        self.hold("past", np.zeros((self.delay + 2, ledger.FINGERS), ledger.MOMENT_TYPE))
        self.hold("carried", np.zeros(1))

    def generated_energy(self, part: str) -> float:
        """Energy [J] that one part has generated."""
        return float(self.own["account"]["accounts"]["generated"][PARTS.index(part)])

    def notes(self) -> list[str]:
        if self.condition():
            self._note_once(
                f"the {PARTS[self.own['by']]} generated {self.own['most'] * 1e3:.3g} mJ, above the bound of "
                f"{self.bound * 1e3:.3g} mJ, at {self.own['time'] * 1e-9:.3f} s: the force falls to zero"
            )
        return super().notes()

    @kernel
    def compute(
        own,
        force: Annotated[list[Force], Wants("force")],
        contact: Annotated[list[Contact | None], PRESS],
        pose: Annotated[list[Pose | None], Wants("position")],
        friction: Annotated[list[Friction | None], Wants("force", "stored")],
        body: Annotated[Surface | None, Wants("stored")],
        others: Annotated[list[Surface | None], Wants("stored")],
        between: Annotated[list[OrganContact | None], Wants("stored", "dissipated", "generated", "carried", "steps")],
        support: Annotated[list[Support | None], Wants("displacement", "rotation", "centre")],
        out: Out[Ledger],
        dt,
    ):
        account, past, count = own.account, _moments_of(own.past), force.count
        moved, before, turns = step_of(own, support)
        lent, moves = 0.0, support.count > 0
        whole = body.there and contact.count >= count and pose.count >= count
        for i in range(count):
            whole = whole and nth(contact, i).there and nth(pose, i).there
        if whole:
            stepped = ledger.begin(account, past, count)
            for i in range(count):
                touch = nth(contact, i)
                along, rubbed, bristles = vector(touch.lateral_force), ZERO, 0.0
                if i < friction.count and nth(friction, i).there:
                    rubbed, bristles = vector(nth(friction, i).force), stored_energy(nth(friction, i).stored)
                ledger.take(
                    account, past, i, nth(pose, i).position, nth(force, i).force, touch.normal, touch.force,
                    touch.compression, touch.indentation, along, rubbed,
                )  # fmt: skip
                stored = (stored_energy(touch.stored), stored_energy(body.stored), bristles)
                if stepped:
                    ledger.add_finger(account, past, i, along, rubbed, stored)
                else:
                    ledger.look_at_finger(account, i, stored)
            elsewhere, given, held, carried, push = of_organs(own, others, between)
            moves = moves or push
            if stepped:
                for i in range(count):
                    way = moved_at(own, vector(nth(pose, i).position), moved, before, turns)
                    lent += ledger.carry(account, past, i, way)
                own.lent += lent
            ledger.end(account, past, stepped, stored_energy(body.stored), elsewhere, given, held, carried)
        else:
            account.moments = 0
        row, most = ledger.worst(account)
        if most > own.bound > 0.0 and not own.tripped:
            own.tripped, own.by, own.most, own.time = True, row, most, nth(force, 0).time
        out.hand, out.controller, out.sampling = account.hand - own.lent, account.controller, account.sampling
        out.fingertip_stored, out.fingertip_dissipated = ledger.totals(account, ledger.FINGERTIP)
        out.tissue_stored, out.tissue_dissipated = ledger.totals(account, ledger.TISSUE)
        organs = account.accounts[ledger.ORGANS]
        out.tissue_stored += organs.stored
        out.tissue_dissipated += organs.work - organs.stored
        out.friction_stored, out.friction_dissipated = ledger.totals(account, ledger.FRICTION)
        out.work, out.balance, out.unexplained = account.work - lent, account.left, account.balance
        out.generated, out.generated_by = most, row + 1 if most != 0.0 else 0
        out.tripped = own.tripped
        if moves:
            floats(own.carried)[0] = own.lent + account.carried
            lend(out.carried, own.carried)
