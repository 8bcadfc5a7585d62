"""Several fingertips on one body."""

import math
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.records import floats, lend_first, nth, put, vector
from palpate.messages import Contact, Contacts, Proximity, Surface
from palpate.messages.contact import Neighbour
from palpate.messages.record import ROOM
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, InputError, Out, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import sample_of
from palpate.nodes.contact import finger
from palpate.nodes.contact.finger import FINGER
from palpate.nodes.contact.neighbours import add_neighbours
from palpate.nodes.contact.seen import SEEN, begin, lifted, see
from palpate.nodes.contact.series import BAD_LAW, BODY, Series, law_of
from palpate.physics.contact.end_rate import arrive
from palpate.physics.contact.joint import effect_of_others, joint_steps
from palpate.physics.contact.organs.backed import backed_laws
from palpate.physics.contact.pool import END, assign_generated, energy_given
from palpate.physics.contact.series import series_energy

MISMATCH = 2  # fault: the number of the body's laws differs from the number of fingers
NEAREST = {"distance": (), "first": int, "second": int, "time": int}
"""Least distance [m] of two fingers, their indices, and the time [ns]; `second` is 0 before any."""
NO_FINGER = 1  # fault: no finger with this index


@kernel
def law_for(body, several, i):
    """Terminal law of contact i; the body's only one unless `several`."""
    if several:
        laws = floats(body.laws)
        return laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4]
    return law_of(body)


@kernel
def slope_for(body, several, i):
    """Tangential gradient [N] (3) and shape operator [1/m] (9) at contact i, and whether the body has sent them."""
    if several:
        slopes = floats(body.slopes)
        return slopes[i, :3], slopes[i, 3:], True
    return body.tangential_gradient[:], body.shape_operator.values[:9], body.shape_operator.count == 9


@kernel
def fault_of(body, count, organs):
    """Fault of a body's message for `count` fingers and the loads of `organs` other bodies; 0: none."""
    several = count + organs > 1
    if several and len(floats(body.laws)) != count + organs:
        return MISMATCH
    for i in range(count):
        if not finger.in_range(law_for(body, several, i), body.step, body.relaxation):
            return BAD_LAW
    return 0


@kernel
def take_laws(own, body, count, neighbour, dt):
    """Keep the laws of `count` fingers on a body and their coupling, with the other bodies that touch it: the body may
    be missing in the next step."""
    several = count + neighbour.count > 1
    laws, coupled = floats(own.laws)[:count], own.coupling[: count * count].reshape(count, count)
    for i in range(count):
        k, n, c, free, previous = law_for(body, several, i)
        laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4] = k, n, c, free, previous
    if several:
        coupling = floats(body.coupling)
        for i in range(count):
            for j in range(count):
                coupled[i, j] = coupling[i, j]
    if neighbour.count > 0:
        yields = floats(own.yields)
        add_neighbours(body, neighbour, count, own.others, yields, own.pressing)
        step = body.step if body.step > 0.0 else dt
        backed_laws(laws, coupled, own.others[:count], yields[:count, :count], own.pressing[:count], step)


@kernel
def measure_distance(own, count):
    """Keep the least distance of two fingers that press the same side of the body, if it is less than their soft tissue
    is thick."""
    nearest = own.nearest
    least = nearest.distance if nearest.second > 0 else own.thickness
    for j in range(1, count):
        for i in range(j):
            if not (own.solved[i, 0] > 0.0 and own.solved[j, 0] > 0.0):
                continue
            one, other = own.seen[i], own.seen[j]
            square = along = 0.0
            for x in range(3):
                square += (one.foot[x] - other.foot[x]) ** 2
                along += one.normal[x] * other.normal[x]
            if along > 0.0 and square < least * least:
                least = math.sqrt(square)
                nearest.distance, nearest.first, nearest.second, nearest.time = least, i, j, one.time


class Joint(Series):
    """Up to 16 fingertips on one body, each in series with it as in `Series` (docs/equations/contact.md).

    All forces of a step are solved together, so the coupling of the fingers has no delay. The approaches have the order
    of the loads at the body. All fingertips have the same law. A `contact.Share` sends the Contact of each finger.

    Of other bodies that touch the body, `neighbour` has the contacts (`contact.Side`), in the order of their loads,
    which follow those of the fingers: all fingers feel them in the same step, as with `contact.Backed`.

    A finger whose messages are missing is lifted off the body within 8 ms (`nodes.contact.seen`); the others stay.
    """

    shares_patch = False
    State = {
        "finger": (ROOM, FINGER), "seen": (ROOM, SEEN),  # the fingertips, and where they are
        "law": (5,),  # their elastic law and its damping
        "approach": (ROOM,), "before": (ROOM,), "terminal": (ROOM, 5), "coupling": (ROOM * ROOM,),  # of `joint_steps`
        "moved": (ROOM,), "waited": (),  # [s] since the last sample of each finger; since the last step
        "length": (ROOM,),  # [s] of the step of each
        "force": (ROOM,), "solved": (ROOM, 3), "lateral": TABLE,
        "laws": TABLE, "others": (ROOM,), "yields": TABLE, "pressing": (ROOM,),  # of the body; of its neighbours
        "nearest": NEAREST,
        "ends": (ROOM, END), "given": (ROOM,), "returned": (ROOM,), "held": (), "generated": (ROOM,),  # [J] of `pool`
    }  # fmt: skip

    def start(self) -> None:
        super().start()
        begin(self.own["seen"])
        self.hold("lateral", np.zeros((ROOM, 3)))
        self.hold("laws", np.zeros((ROOM, 5)))
        self.hold("yields", np.zeros((ROOM, ROOM)))

    @kernel
    def idle(own, proximity, body, neighbour, out, dt):
        count, organs = proximity.count, neighbour.count
        if not body.there or (count + organs > 1 and len(floats(body.laws)) != count + organs):
            return False
        take_laws(own, body, count, neighbour, dt)
        laws = floats(own.laws)
        for i in range(count):
            law = laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4]
            near = nth(proximity, i)
            if not near.there or own.seen[i].missing:
                return False
            if not finger.at_rest(own.finger[i], near, True, law, body.step, body.relaxation):
                return False
        for i in range(count):
            own.finger[i].sampled = sample_of(nth(proximity, i))
        return True

    @ieee_kernel
    def compute(
        own,
        proximity: list[Proximity | None],
        body: Annotated[Surface | None, Wants(*BODY.names, "laws", "slopes", "coupling")],
        neighbour: list[Neighbour | None],
        out: Out[Contacts],
        dt,
    ):
        # Time since the last sample of each finger; without a newer one of any, the answer stays.
        count, longest = proximity.count, 0.0
        for i in range(count):
            own.moved[i] = see(own.seen[i], own.finger[i], nth(proximity, i), dt)
            longest = max(longest, own.moved[i])
        if longest == 0.0 and body.there and count > 0:
            own.waited += dt
            return
        dt, own.waited = dt + own.waited, 0.0
        # Laws and coupling of the contacts by the body and by those that touch it.
        several, laws = body.there and count + neighbour.count > 1, floats(own.laws)
        if body.there:
            own.fault = fault_of(body, count, neighbour.count)
            if own.fault != 0:
                return
            take_laws(own, body, count, neighbour, dt)
        # Approach, fingertip law and terminal law of each contact.
        pressed, length, time = False, 0.0, sample_of(body)
        for i in range(count):
            one, near = own.finger[i], own.seen[i]
            moved = own.moved[i]
            arrive(one.course, near.tick if own.second_order and moved == dt else -1)
            given = laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3], laws[i, 4]
            presses, approach, step, law = finger.pressing(
                one, near, body.there, given, body.step, body.relaxation, time, dt, moved
            )
            if presses:
                own.approach[i], terminal = approach, own.terminal[i]
                terminal[0], terminal[1], terminal[2], terminal[3], terminal[4] = law
                pressed = True
                if near.missing:
                    others = effect_of_others(i, own.coupling[: count * count].reshape(count, count), own.force[:count])
                    own.approach[i] = min(approach, lifted(near, own.law[:], law, others))
                else:
                    length = max(step, length)  # after a gap the longest step, see `finger.step_length`
            own.before[i] = finger.start_of(one)
        # Solve for the normal forces of all contacts together.
        if pressed:
            for i in range(count):
                own.length[i] = length if length > 0.0 and not own.seen[i].missing else math.inf
            joint_steps(
                own.approach[:count], own.length[:count], own.before[:count], own.law[:], own.terminal[:count],
                own.coupling[: count * count].reshape(count, count), own.force[:count], own.solved[:count],
            )  # fmt: skip
            measure_distance(own, count)
        # New state and output of each contact.
        lateral, most = floats(own.lateral), 0.0
        for i in range(count):
            one, f = own.finger[i], own.solved[i]
            gradient, shape, sloped = slope_for(body, several, i)
            out.force.values[i], out.indentation.values[i], rate, out.indentation_rate.values[i], along = finger.settle(
                one, own.seen[i], body.there, gradient, shape, sloped, own.law[4], own.thickness, pressed,
                (f[0], f[1], f[2]), dt,
            )  # fmt: skip
            out.compression.values[i], out.compression_rate.values[i] = one.compression, rate
            lateral[i, 0], lateral[i, 1], lateral[i, 2] = along
            end, near = own.ends[i], own.seen[i]
            own.given[i], own.returned[i] = energy_given(
                end, out.force.values[i], near.gap, along, vector(near.slip), one.withheld, own.moved[i]
            )
            end.known = not near.missing
            most += out.force.values[i] * (one.compression + max(out.indentation.values[i], 0.0))
            if own.energy:
                out.stored.values[i] = series_energy(
                    one.compression, int(own.law[0]), own.law[1], own.law[2], own.law[3]
                )
        out.force.count = out.indentation.count = out.indentation_rate.count = count
        out.compression.count = out.compression_rate.count = count
        out.stored.count = count if own.energy else 0
        out.generated.count = 0
        if neighbour.count == 0:
            own.held = assign_generated(own.held, own.given[:count], own.returned[:count], most, own.generated[:count])
            out.generated.count = count
            for i in range(count):
                out.generated.values[i] = own.generated[i]
        out.lateral_force.address = own.lateral.address
        out.lateral_force.shape[0], out.lateral_force.shape[1] = count, 3

    def notes(self) -> list[str]:
        nearest = self.known["nearest"]
        if nearest["second"] > 0 and "nearest" not in self._noted:
            self._noted.add("nearest")
            when = f" at {nearest['time'] * 1e-9:.3f} s" if nearest["time"] >= 0 else ""
            self._notes.append(
                f"{type(self).__name__}: fingers {nearest['first']} and {nearest['second']} (counted from 0) press "
                f"places {1e3 * nearest['distance']:.2g} mm apart{when}, less than their soft tissue is thick. "
                "Fingertips do not keep each other apart here: the forces of both are approximate there"
            )
        return super().notes()

    def explain(self, fault: int, *messages: Any) -> Exception:
        fingers, body, neighbours = messages
        if fault == MISMATCH:
            count, organs = len(fingers), len(neighbours)
            of_organs = f", then one of each contact.Side of `neighbour`: {organs}" if organs else ""
            return InputError(
                body, f"found laws of {len(body.laws)} contacts, expected {count + organs}: one per finger{of_organs}"
            )
        return super().explain(fault, fingers, body)


class Share(CompiledNode):
    """The contact of one of the fingers of a `contact.Joint`: the one with the same input `proximity`.

    finger  its index at the joint, from 0; -1: determined when the graph is loaded

    While `proximity` is missing, the contact stays at its last place: the joint lifts the finger off there, and the
    body must feel that. Nothing is computed from `body`: it shows the controller that the joint lacks the body, so that
    the force returns as after an outage, as with `Series`.
    """

    finger: Annotated[int, "1", msgspec.Meta(ge=-1, lt=ROOM)] = -1

    State = {"foot": (3,), "normal": (3,), "generated": ARRAY}  # [m], [1] of the last message; [J] that is sent

    def start(self) -> None:
        super().start()
        self.own["normal"] = (0.0, 0.0, 1.0)
        self.hold("generated", np.zeros(1))

    @kernel
    def compute(
        own,
        contacts: Contacts,
        proximity: Annotated[Proximity | None, Wants("foot", "normal")],
        body: Annotated[Surface | None, Wants("step")],
        out: Out[Contact],
        dt,
    ):
        i = own.finger
        if not 0 <= i < contacts.force.count:
            own.fault = NO_FINGER
            return
        out.delayed = contacts.delayed
        if proximity.there:
            put(own.foot, vector(proximity.foot))
            put(own.normal, vector(proximity.normal))
        put(out.foot, vector(own.foot))
        put(out.normal, vector(own.normal))
        out.force = contacts.force.values[i]
        out.compression, out.indentation = contacts.compression.values[i], contacts.indentation.values[i]
        out.compression_rate = contacts.compression_rate.values[i]
        out.indentation_rate = contacts.indentation_rate.values[i]
        lateral = floats(contacts.lateral_force)
        put(out.lateral_force, (lateral[i, 0], lateral[i, 1], lateral[i, 2]))
        out.stored.count = 1 if contacts.stored.count > i else 0
        out.stored.values[0] = contacts.stored.values[i]
        known = contacts.generated.count > i
        if known:
            floats(own.generated)[0] = contacts.generated.values[i]
        lend_first(out.generated, own.generated, 1 if known else 0)

    def explain(self, fault: int, *messages: Any) -> Exception:
        contacts = messages[0]
        return InputError(
            contacts, f"found {len(contacts.force)} fingers, expected the one at place {self.finger}, counted from 0. "
            "The setting `finger` says which; a graph that is loaded finds it by the input `proximity`"
        )  # fmt: skip
