"""Normal contact of fingertip and tissue."""

import math
from typing import Annotated, Literal

import msgspec

from palpate.messages import Contact, Proximity, Surface, Vector, Vector3
from palpate.messages.tissue import SeenSurface
from palpate.nodes.base import InputError, Node, Switch, Wants, part
from palpate.nodes.base.absence import FALL, Gain
from palpate.physics.bodies.place_energy import on_hand
from palpate.physics.contact import series as laws
from palpate.physics.contact.terminal import LEAST_FREE, Terminal, check_law, free_recovery, law_at
from palpate.physics.entry_point import entry_point

FAR = 2e-3  # [m] from touching, beyond which an idle contact sleeps; at 1 kHz a finger of 2 m/s wakes it a step before
STILL = 1e-9  # [m] indentation below which an unloaded body counts as at rest
LATE = 1.5  # [1] steps of the contact after which a law is an old one
NOWHERE = 0.0, 0.0, -1  # compression [m], force [N] and time [ns] of what never was
RETURN = 0.1  # [s] in which the contact comes back to the whole approach when its body is back
Positive = msgspec.Meta(gt=0)
Law = tuple[float, float, float, float, float]
Heard = Surface | SeenSurface
LAW = ("stiffness", "exponent", "damping", "rest_indentation", "previous_indentation")
BODY = Wants(*LAW, "step", "relaxation", "tangential_gradient", "shape_operator")


class Series(Node):
    """Fingertip and tissue in series: they share the approach and press on each other with one force
    (docs/equations/contact.md).

    The tissue answers by the terminal law of its last message. Where that is older than a step (a tissue that runs at a
    divisor, a message that is held) the law is taken for the present time, and the contact's own memory of the
    indentation for that of the tissue. Where it says how its energy changes along the surface, the finger feels that,
    too: force and place have one energy (docs/equations/reduced-fe.md). Idle and farther than 2 mm from touching it
    sleeps, and its foot and normal stay as they were.

    Without tissue there is nothing to press on: the force is zero and the fingertip recovers. A tissue that was there
    and is missing is left within 8 ms: its last law answers, at rest, to an approach that falls to where the force is
    zero. When it is back, or where this node itself joins a run that goes on, the approach comes in again within 0.1 s
    from where the two just touch. So neither of them sees an approach that jumped, which the damping of both would
    answer with a blow of many times the force.
    """

    finger_law: Annotated[Literal["exponential", "power", "hertz"], "1"] = "exponential"
    finger_damping: Annotated[float, "s/m", msgspec.Meta(ge=0), Switch("relaxation")] = 8.0
    finger_stiffness: Annotated[float, "N/m", Positive] = 26.2641
    """of the exponential law"""
    finger_hardening: Annotated[float, "1/m", Positive] = 1681.06
    """of the exponential law"""
    finger_power_stiffness: Annotated[float, "N/m^n", Positive] = 8.1e3
    finger_power_exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=10)] = 1.5
    finger_hertz_slope: Annotated[float, "Pa/m", Positive] = 5.672e6
    finger_hertz_hardening: Annotated[float, "1/m", Positive] = 466.6
    finger_hertz_radius: Annotated[float, "m", Positive] = 9.84e-3
    thickness: Annotated[float, "m", msgspec.Meta(ge=0)] = 4e-3
    """Of the soft tissue before the bone: a compression beyond it is reported, as no law is valid there; 0: unknown."""

    def start(self) -> None:
        self._notes, self._beyond, self._reported = [], NOWHERE, False
        self.compression = 0.0
        self.indentation: float | None = None
        self._idle = False
        self._there = Gain(2.0 * FALL, 0.0)
        self._law_then: Law | None = None
        self._touched_at: float | None = None
        """[m] Approach from which the contact comes back; None: it feels all of the approach."""
        self._back_for = 0.0
        self._finger_law = self._finger()
        self._law = laws.kernel_form(self._finger_law, self.finger_damping)
        self._series = entry_point(laws.series_step, 0.0, 0.0, 0.0, self._law, 0.0, 0.0, 0.0, 0.0, 0.0)
        free_recovery(0.0, 0.0, self.finger_damping, 1e-3)  # compiled by the time that a body is missing

    def _finger(self) -> laws.ElasticLaw:
        if self.finger_law == "power":
            return laws.power(self.finger_power_stiffness, self.finger_power_exponent)
        if self.finger_law == "hertz":
            return laws.hertz_exponential(
                self.finger_hertz_slope, self.finger_hertz_hardening, self.finger_hertz_radius
            )
        return laws.exponential(self.finger_stiffness, self.finger_hardening)

    def _law_now(self, body: Heard, time: int, dt: float) -> Law:
        """K, n, c, s_free, s_prev of the body's law for a step of `dt` [s] that ends at `time` [ns].

        InputError: a law out of its range.
        """
        k, n, c, free = body.stiffness, body.exponent, body.damping, body.rest_indentation
        previous = body.previous_indentation
        law = k, n, c, free, previous
        step, relaxation = body.step, body.relaxation
        if not _in_range(body):
            try:
                check_law(Terminal(*law), step, relaxation)
            except ValueError as error:
                raise InputError(body, str(error)) from None
        age = (time - body.time) * 1e-9 if time >= 0 and body.time >= 0 else dt
        if not (age > LATE * dt or step > LATE * dt) or self.indentation is None:
            return law
        if step > LATE * dt:  # its own step is longer: it comes through it with the contact, and ends it alike
            k, free = law_at(max(age, dt), previous, Terminal(*law), step, relaxation)
        else:  # its message is held, or late: from where the contact has been since
            k, free = law_at(dt, self.indentation, Terminal(*law), step, relaxation)
        return k, n, c, free, self.indentation

    def _touching(self, law: Law, dt: float) -> float:
        """The approach [m] at which fingertip and body just touch, or that which the contact has at present."""
        _, _, c, free, previous = law
        just = free_recovery(self.compression, 0.0, self.finger_damping, dt) + free_recovery(previous, free, c, dt)
        return max(just, self.compression + (self.indentation or 0.0))

    def _felt(self, approach: float, dt: float) -> float:
        """The approach [m] that fingertip and body feel: all of it, but for `RETURN` after the body was missing."""
        begin = self._touched_at
        if begin is None:
            return approach
        self._back_for += dt
        left = 1.0 - self._back_for / RETURN
        if left <= 0.0 or approach <= begin:
            self._touched_at = None
            return approach
        return approach - left * left * (approach - begin)

    def rests(self, proximity: Proximity, body: Heard | None) -> bool:
        if not self._idle or body is None or not proximity.separation > FAR:
            return False
        return abs(body.rest_indentation) < STILL and abs(body.previous_indentation) < STILL and _in_range(body)

    def step(self, proximity: Proximity, body: Annotated[Surface | None, BODY], *, dt: float) -> Contact:
        pressing = self.pressing(proximity, body, dt)
        solved = None
        if pressing is not None:
            approach, length, law = pressing
            solved = self._series(approach, length, self.compression, self._law, *law)
        return self.contact(proximity, body, solved, dt)

    def pressing(self, proximity: Proximity, body: Heard | None, dt: float) -> tuple[float, float, Law] | None:
        """Approach [m], length of the step [s] and the body's law, which determine the force of this step; None where
        there is nothing to press on."""
        back = self._there.value < 1.0 or (self._law_then is None and proximity.tick > 0)
        if body is None or self._there.value < 1.0:
            self._there.update(body is not None or self._law_then is None, dt)
        if body is not None:
            law = self._law_then = self._law_now(body, proximity.time, dt)
            if back:
                self._touched_at, self._back_for = self._touching(law, dt), 0.0
            return self._felt(proximity.approach, dt), dt, law
        if self._law_then is not None and self._there.value > 0.0:
            free = max(self._law_then[3], 0.0)
            return free + self._there.value * (proximity.approach - free), math.inf, self._law_then
        return None

    def contact(
        self, proximity: Proximity, body: Heard | None, solved: tuple[float, float, float] | None, dt: float
    ) -> Contact:
        """The contact of this step, of which force, compression and indentation are solved."""
        before = self.compression
        lateral: Vector3 = (0.0, 0.0, 0.0)
        force = indentation = indentation_rate = 0.0
        if solved is None:
            self.indentation = None
            self.compression = free_recovery(before, 0.0, self.finger_damping, dt)
        else:
            force, self.compression, indentation = solved
            self.indentation = indentation
        if body is not None and self._law_then is not None:
            indentation_rate = (indentation - self._law_then[-1]) / dt
            if force > 0.0 and len(body.shape_operator) == 9:
                lateral = on_hand(body.tangential_gradient, body.shape_operator, proximity.approach, proximity.normal)
        rate = (self.compression - before) / dt
        if self.compression > self.thickness > 0.0:
            self._beyond = max(self._beyond, (self.compression, force, proximity.time))
        self._idle = force == 0.0 and before == self.compression and abs(indentation) < STILL
        return Contact(
            foot=proximity.foot,
            normal=proximity.normal,
            force=force,
            compression=self.compression,
            indentation=indentation,
            compression_rate=rate,
            indentation_rate=indentation_rate,
            lateral_force=lateral,
            stored=self._stored(),
        )

    def condition(self) -> str:
        return "beyond its law" if self.compression > self.thickness > 0.0 else ""

    def notes(self) -> list[str]:
        deepest, force, time = self._beyond
        if deepest > 0.0 and not self._reported:
            self._reported = True
            when = f" at {time * 1e-9:.3f} s" if time >= 0 else ""
            self._notes.append(
                f"{type(self).__name__}: the fingertip is compressed by {1e3 * deepest:.3g} mm{when}, its soft tissue "
                f"is {1e3 * self.thickness:.3g} mm thick. Its law is not valid there: the force, {force:.3g} N, is "
                "meaningless"
            )
        return super().notes()

    @part("energy", "stored", otherwise=())
    def _stored(self) -> Vector:
        """The energy that the fingertip holds."""
        return (float(laws.energy(self._finger_law, self.compression)),)


def _in_range(body: Heard) -> bool:
    """Whether a body's law passes `check_law`, which tells why it does not: asked every tick."""
    k, c, free, step, relaxation = body.stiffness, body.damping, body.rest_indentation, body.step, body.relaxation
    return (
        k > 0.0
        and 1.0 <= body.exponent <= 3.0
        and c >= 0.0
        and free >= LEAST_FREE
        and step >= 0.0
        and relaxation >= 0.0
        and -math.inf < k + c + free + body.previous_indentation + step + relaxation < math.inf
    )
