"""Normal contact of fingertip and tissue."""

import math
from typing import Annotated, Literal

import msgspec

from palpate.messages import Contact, Proximity, Surface, Vector, Vector3
from palpate.messages.tissue import SeenSurface
from palpate.nodes.base import InputError, Node, Switch, Wants, part
from palpate.nodes.base.absence import FALL
from palpate.physics.bodies.place_energy import on_hand
from palpate.physics.contact import series as laws
from palpate.physics.contact.terminal import LEAST_FREE, Terminal, check_law, free_recovery, law_at
from palpate.physics.entry_point import entry_point

FAR = 2e-3  # [m] from touching, beyond which an idle contact sleeps; at 1 kHz a finger of 2 m/s wakes it a step before
STILL = 1e-9  # [m] indentation below which an unloaded body counts as at rest
LATE = 1.5  # [1] steps of the contact after which a law is an old one, and usual steps after which a step spans a gap
AGREE = 1e-6  # [m] by which the indentations of contact and body may differ where they are in step again
GONE = 2.0 * FALL  # [s] in which the force falls to zero when the body is missing
REST = 1e3  # [s] a step after which any body is at rest
RETURN, CATCH_UP = 0.03, 20e-3  # [s], [m/s] of the approach that is withheld after an outage: w' = -w/RETURN - CATCH_UP
NOWHERE = 0.0, 0.0, -1  # compression [m], force [N] and time [ns] of what never was
Positive = msgspec.Meta(gt=0)
Law = tuple[float, float, float, float, float]
Heard = Surface | SeenSurface
LAW = ("stiffness", "exponent", "damping", "rest_indentation", "previous_indentation")
BODY = Wants(*LAW, "step", "relaxation", "tangential_gradient", "shape_operator")


class Series(Node):
    """Fingertip and tissue in series: they share the approach and press on each other with one force
    (docs/equations/contact.md).

    The tissue answers by the terminal law of its last message. Where that law is for another step than the contact's (a
    tissue at a divisor, messages that are late or lost), it is taken for the contact's step, from the contact's own
    indentation, until both agree again within 1 um. So a late message makes no jump of the indentation, which damping
    would answer with a force spike. Where the tissue says how its energy changes along the surface, the finger feels
    that, too: force and place have one energy (docs/equations/reduced-fe.md). Idle and farther than 2 mm from touching
    the node sleeps, and its foot and normal stay as they were.

    Without tissue there is nothing to press on: the force is zero and the fingertip recovers. A tissue that was there
    and is missing is left within 8 ms: its last law answers, at rest, to an approach that falls to zero. When it is
    back, or where this node itself joins a run in progress, the approach begins at the sum of compression and
    indentation, and the rest w, which is withheld, decays: w' = -w/(30 ms) - 20 mm/s, 0.1 s for 15 mm.
    """

    finger_law: Annotated[Literal["exponential", "power", "hertz"], "1"] = "exponential"
    finger_damping: Annotated[float, "s/m", msgspec.Meta(ge=0), Switch("relaxation")] = 8.0
    finger_stiffness: Annotated[float, "N/m", Positive] = 26.2641  # of the exponential law
    finger_hardening: Annotated[float, "1/m", Positive] = 1681.06  # of the exponential law
    finger_power_stiffness: Annotated[float, "N/m^n", Positive] = 8.1e3
    finger_power_exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=10)] = 1.5
    finger_hertz_slope: Annotated[float, "Pa/m", Positive] = 5.672e6
    finger_hertz_hardening: Annotated[float, "1/m", Positive] = 466.6
    finger_hertz_radius: Annotated[float, "m", Positive] = 9.84e-3
    thickness: Annotated[float, "m", msgspec.Meta(ge=0)] = 4e-3
    """Of the soft tissue before the bone: a compression beyond it is reported, as no law is valid there; 0: unknown."""

    compression = 0.0
    _beyond, _reported = NOWHERE, False  # of a node that never started, too: notes are collected from all

    def start(self) -> None:
        self._notes, self._beyond, self._reported = [], NOWHERE, False
        self.compression = 0.0
        self.indentation: float | None = None
        self._idle = False
        self._previous = 0.0
        self._in_step = True
        self._withheld = 0.0
        self._heard: Heard | None = None
        self._usual, self._depth, self._motion = math.inf, 0.0, (0.0, 0.0)
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

    def _length(self, proximity: Proximity, dt: float) -> float:
        """Length [s] of the step over which the damping takes the motion: `dt`, except after a gap in which the finger
        came nearer.

        An implicit step over a gap meets its mean rate at its full depth, although a finger that hits the tissue in it
        may rest by now. So the rate at its end is extrapolated from the mean rates v, v_0 of this step and the one
        before, of lengths T and T_0: v_end = v + (v - v_0) T/(T + T_0) within [0, v]. The step is as long as the same
        motion takes at v_end. A gap that begins before contact, where v_0 is unknown because this node may sleep, ends
        at rest.
        """
        depth = proximity.approach - proximity.separation
        rate, (rate_before, dt_before) = (depth - self._depth) / dt, self._motion
        self._usual, self._depth, self._motion = min(self._usual, dt), depth, (rate, dt)
        if dt <= LATE * self._usual or not rate > 0.0:
            return dt
        end = 0.0 if self._idle else min(rate + (rate - rate_before) * dt / (dt + dt_before), rate)
        return min(dt * rate / end, REST) if end > 0.0 else REST

    def _law_now(self, body: Heard, time: int, dt: float, length: float) -> Law:
        """K, n, c, s_free, s_prev of the body's law for a step of `dt` [s] that ends at `time` [ns], taken as `length`.
        InputError: a law out of its range."""
        k, n, c, free, previous = law = _law(body)
        step, own = body.step, self.indentation
        if not _in_range(body):
            try:
                check_law(Terminal(*law), step, body.relaxation)
            except ValueError as error:
                raise InputError(body, str(error)) from None
        age = (time - body.time) * 1e-9 if time >= 0 and body.time >= 0 else dt
        fresh = age <= LATE * dt and step <= LATE * dt and (dt <= LATE * step or step == 0.0)
        self._in_step = fresh and (self._in_step or own is None or abs(own - previous) <= AGREE)
        if own is None or (self._in_step and length == dt):
            return law
        k, free = law_at(length, own, Terminal(*law), step, body.relaxation)
        return k, n, c, free, own

    def _feel(self, proximity: Proximity, previous: float, dt: float) -> float:
        """The approach [m] that fingertip and body feel: all of it, but for a while after the body was missing."""
        if self.indentation is None and proximity.tick > 0:
            self._withheld = proximity.approach - self.compression - previous
        elif self._withheld > 0.0:
            self._withheld = (self._withheld - CATCH_UP * dt) / (1.0 + dt / RETURN)
        self._withheld = max(self._withheld, 0.0)
        return proximity.approach - self._withheld

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
        length = self._length(proximity, dt)
        if body is not None:
            self._heard = body
            law = self._law_now(body, proximity.time, dt, length)
            self._previous = law[-1]
            return self._feel(proximity, self._previous, dt), length, law
        self.indentation, self._in_step = None, True
        self._withheld += max(proximity.approach, 0.0) * dt / GONE
        felt = proximity.approach - self._withheld
        if self._heard is None or not felt > STILL:
            return None
        k, n, c, free, previous = law = _law(self._heard)
        k, free = law_at(REST, previous, Terminal(*law), self._heard.step, self._heard.relaxation)
        return felt, math.inf, (k, n, c, free, previous)

    def contact(
        self, proximity: Proximity, body: Heard | None, solved: tuple[float, float, float] | None, dt: float
    ) -> Contact:
        """The contact of this step, of which force, compression and indentation are solved."""
        before = self.compression
        lateral: Vector3 = (0.0, 0.0, 0.0)
        force = indentation = indentation_rate = 0.0
        if solved is None:
            self.compression = free_recovery(before, 0.0, self.finger_damping, dt)
        else:
            force, self.compression, indentation = solved
        if body is not None:
            indentation_rate = (indentation - self._previous) / dt
            self.indentation = indentation
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


def _law(body: Heard) -> Law:
    return body.stiffness, body.exponent, body.damping, body.rest_indentation, body.previous_indentation


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
