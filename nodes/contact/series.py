"""Normal contact of fingertip and tissue."""

from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.records import floats, lend, one, put, vector
from palpate.messages import Contact, Pose, Proximity, Surface
from palpate.nodes.base import ARRAY, Agrees, CompiledNode, InputError, Out, Part, Switch, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import sample_of, since
from palpate.nodes.contact import finger
from palpate.nodes.contact.finger import FINGER
from palpate.physics.contact import series as laws
from palpate.physics.contact.end_rate import arrive
from palpate.physics.contact.people import PEOPLE
from palpate.physics.contact.terminal import Terminal, check_law

Positive = msgspec.Meta(gt=0)
LAW = ("stiffness", "exponent", "damping", "rest_indentation", "previous_indentation")
BODY = Wants(*LAW, "step", "relaxation", "tangential_gradient", "shape_operator")
BAD_LAW = 1  # fault: the body's law is out of its range


@kernel
def law_of(body):
    """K, n, c, s_free and s_prev of a body's message."""
    return body.stiffness, body.exponent, body.damping, body.rest_indentation, body.previous_indentation


@ieee_kernel
def touch(own, proximity, body, law, gradient, shape, sloped, out, dt):
    """A step of one fingertip against the law of its body: fills the Contact.

    law  K, n, c, s_free and s_prev
    gradient [N] (3), shape [1/m] (9)  of the body's energy along the surface, valid if `sloped`
    """
    moved = since(own.finger, sample_of(proximity), dt)
    if moved == 0.0 and body.there:
        return
    arrive(own.finger.course, proximity.tick if own.second_order and moved == dt else -1)
    dt = moved if moved > 0.0 else dt
    pressed, approach, length, law = finger.pressing(
        own.finger, proximity, body.there, law, body.step, body.relaxation, sample_of(body), dt, moved
    )
    solved = (0.0, 0.0, 0.0)
    if pressed:
        k, n, c, free, previous = law
        solved = laws.series_step(approach, length, finger.start_of(own.finger), own.law[:], k, n, c, free, previous)
    out.force, out.indentation, out.compression_rate, out.indentation_rate, lateral = finger.settle(
        own.finger, proximity, body.there, gradient, shape, sloped, own.finger_damping, own.thickness, pressed, solved,
        dt,
    )  # fmt: skip
    out.compression = own.finger.compression
    put(out.foot, vector(proximity.foot))
    put(out.normal, vector(proximity.normal))
    put(out.lateral_force, lateral)
    share = 1.0
    if proximity.share.shape[0] > 0:  # the rest of the patch is on other organs
        share = floats(proximity.share)[0]
        floats(own.whole)[0] = out.force
        lend(out.whole, own.whole)
        out.force *= share
        for axis in range(3):
            out.lateral_force[axis] *= share
    if own.energy:
        energy = laws.series_energy(own.finger.compression, int(own.law[0]), own.law[1], own.law[2], own.law[3])
        one(out.stored, share * energy)


class Series(CompiledNode):
    """Fingertip and tissue in series: they share the approach and have one contact force (docs/equations/contact.md).

    The tissue is represented by the terminal law of its last message. If this law is for another step than the
    contact's (a tissue at a divisor, late or lost messages), it is converted to the contact's step, starting from the
    contact's indentation, until both agree again within 1 um. So a late message causes no jump of the indentation,
    which the damping would turn into a force spike. If the tissue sends the change of its energy along the surface, the
    force on the finger includes it, so that the force is the gradient of one energy (docs/equations/reduced-fe.md). An
    idle node more than 2 mm from contact sleeps; its foot and normal then keep their values.

    Where several organs are under the finger, each contact solves for a patch that is on its organ alone, `whole`, and
    sends the part of it on this organ (`Proximity.share`).

    A step lasts from one sample of the position to the next, according to the age of the messages. While a network or a
    collision at a divisor repeats a sample, the answer stays, so that the next one does not count as the motion of one
    tick.

    Without tissue the force is zero and the fingertip recovers. If the tissue disappears, the force falls to zero
    within 8 ms: the last law, at rest, is applied to an approach that falls to zero. When the tissue returns, or if
    this node joins a run in progress, the effective approach begins at the sum of compression and indentation, and the
    withheld remainder returns (`finger.regained`), 0.11 s for 15 mm.
    """

    finger_law: Annotated[Literal["exponential", "power", "hertz", "soft", "median", "stiff"], "1"] = "exponential"
    """Law of the fingertip; soft, median and stiff: exponential, with the constants of measured people."""
    finger_damping: Annotated[float, "s/m", msgspec.Meta(ge=0), Switch("relaxation")] = 8.0
    finger_stiffness: Annotated[float, "N/m", Positive] = 26.2641  # of the exponential law
    finger_hardening: Annotated[float, "1/m", Positive] = 1681.06  # of the exponential law
    finger_power_stiffness: Annotated[float, "N/m^n", Positive] = 8.1e3
    finger_power_exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=10)] = 1.5
    finger_hertz_slope: Annotated[float, "Pa/m", Positive] = 5.672e6
    finger_hertz_hardening: Annotated[float, "1/m", Positive] = 466.6
    finger_hertz_radius: Annotated[float, "m", Positive] = 9.84e-3
    second_order: Annotated[bool, "1", Agrees(Surface)] = False
    """Whether the damping uses the rate at the end of a step, as fast taps need, instead of its mean rate. Then a
    whole motion dissipates energy, but a single step may return some nJ. Set it for the body too."""
    thickness: Annotated[float, "m", msgspec.Meta(ge=0), Agrees(Pose, Proximity)] = 4e-3
    """Of the soft tissue in front of the bone; a greater compression is outside the range of every law and is reported;
    0: unknown."""

    energy = Part("energy", "stored", about="The energy stored in the fingertip.")
    shares_patch = True
    """Whether it sends its part of a patch that is on several organs."""

    State = {"finger": FINGER, "law": (5,), "whole": ARRAY}
    """The fingertip; its elastic law and its damping (`physics.contact.series.kernel_form`); the force of the whole
    patch, where several organs are under it."""

    def start(self) -> None:
        super().start()
        if "whole" in self.State:
            self.hold("whole", np.zeros(1))
        finger.begin(self.own["finger"])
        self.own["law"] = self.finger_form()

    def finger_form(self) -> np.ndarray:
        """The fingertip's law and its damping (5), see `physics.contact.series.kernel_form`."""
        return laws.kernel_form(self._elastic(), self.finger_damping)

    def _elastic(self) -> laws.ElasticLaw:
        if self.finger_law in PEOPLE:
            return laws.exponential(*PEOPLE[self.finger_law])
        if self.finger_law == "power":
            return laws.power(self.finger_power_stiffness, self.finger_power_exponent)
        if self.finger_law == "hertz":
            return laws.hertz_exponential(
                self.finger_hertz_slope, self.finger_hertz_hardening, self.finger_hertz_radius
            )
        return laws.exponential(self.finger_stiffness, self.finger_hardening)

    @kernel
    def idle(own, proximity, body, out, dt):
        if not finger.at_rest(own.finger, proximity, body.there, law_of(body), body.step, body.relaxation):
            return False
        own.finger.sampled = sample_of(proximity)
        return True

    @ieee_kernel
    def compute(own, proximity: Proximity, body: Annotated[Surface | None, BODY], out: Out[Contact], dt):
        law = law_of(body)
        if body.there and not finger.in_range(law, body.step, body.relaxation):
            own.fault = BAD_LAW
            return
        gradient, shape = body.tangential_gradient[:], body.shape_operator.values[:9]
        touch(own, proximity, body, law, gradient, shape, body.shape_operator.count == 9, out, dt)

    def explain(self, fault: int, *messages: Any) -> Exception:
        """Why the body's law was refused."""
        body = messages[1]
        for law in body.laws.tolist() or [[getattr(body, name) for name in LAW]]:
            try:
                check_law(Terminal(*law), body.step, body.relaxation)
            except ValueError as error:
                return InputError(body, str(error))
        return super().explain(fault, *messages)

    def condition(self) -> str:
        deep = any(each["compression"] > self.thickness > 0.0 for each in self._fingers())
        return "beyond its law" if deep else ""

    def notes(self) -> list[str]:
        for place, each in enumerate(self._fingers()):
            if each["deepest"][0] > 0.0 and f"finger {place}" not in self._noted:
                self._noted.add(f"finger {place}")
                self._notes.append(self._beyond(each))
        return super().notes()

    def _fingers(self) -> Any:
        """The state of each fingertip."""
        return np.atleast_1d(self.known["finger"])

    def _beyond(self, state: Any) -> str:
        """The note of a fingertip that was compressed beyond its tissue."""
        (deepest, force, _), time = state["deepest"], state["deepest_time"]
        when = f" at {time * 1e-9:.3f} s" if time >= 0 else ""
        return (
            f"{type(self).__name__}: the fingertip is compressed by {1e3 * deepest:.3g} mm{when}, its soft tissue "
            f"is {1e3 * self.thickness:.3g} mm thick. Its law is not valid there: the force, {force:.3g} N, is "
            "meaningless"
        )
