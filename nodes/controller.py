"""The controller between the computed contact and the device (docs/equations/controller.md)."""

import math
from typing import Annotated

import msgspec

from palpate.compiler.fields import form
from palpate.compiler.records import floats, put, unpacking, vector
from palpate.messages import Contact, DeviceState, Force, Friction, Ledger, Pose
from palpate.nodes.base import CompiledNode, Ideal, Out, Wants
from palpate.nodes.base.absence import (
    FADE,
    FADED,
    FALL,
    GAIN,
    GAP,
    PACE,
    begin,
    fade_value,
    gap_of,
    keep_pace,
    step_gain,
)
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.physics.device.controller import (
    GAINS,
    STATE,
    Past,
    haptic,
    reset,
    rings,
)
from palpate.physics.device.rendered import stiffest

GENTLE = 500.0  # [N/s] largest slew rate of the force of the added damping after an outage, until contact ends
SETTLE = 1.0  # [s] time in which the force recovers after an outage while it pushes the hand outward, instead of `ramp`
LENT = 0.5e-3  # [J] energy that the display may generate after an outage before the force stops rising
STEEP = 0.25  # [s] time constant of the averages of a contact's force and of its withheld part
MOST_WITHHELD = 0.05  # [1] withheld share of the force above which a note is printed; people notice about 7 %
YIELD = 25e-3  # [s] time in which the force falls to zero again while the display generates more than `LENT`
PATIENCE = 0.5  # [s] duration of withheld force after which the permitted energy grows and a note is printed
POWER = 10e-3  # [W] growth of the permitted energy from then on, until the full force has recovered

FREE, CONTACT = 0, 1  # indices of the values of `Force.state`
_past_of = unpacking(Past)


@kernel
def find_lost_input(had, present):
    """(whether a message lacks an input that earlier messages of its sender had, bit mask of all inputs so far)."""
    return present != had | present, had | present


@kernel
def come_back(own):
    """Reset the state after an outage, except the current force on the hand and the energy of the display."""
    state = own.state
    force, brake, energy, contact = vector(state.force), vector(state.brake), state.energy, state.contact
    reset(state, _past_of(own.past))
    put(state.force, force)
    put(state.brake, brake)
    state.energy, state.rise, state.contact = energy, GENTLE, contact
    state.made = max(-energy, 0.0)
    own.least = min(energy, 0.0) - LENT


@kernel
def forget_credit(own, released, dt):
    """Discard energy observed for commands that the device did not apply.

    Before a device releases its motors, it repeats an older command for up to `GAP` or three steps. The remaining
    energy is the least of this interval and the one before.
    """
    state = own.state
    if released:
        state.energy = min(state.energy, own.credit[0], own.credit[1])
        state.made = max(state.made, -state.energy)
    own.interval += dt
    if own.interval > max(GAP, 3.0 * dt):
        own.credit[1], own.credit[0], own.interval = own.credit[0], state.energy, 0.0
    own.credit[0] = min(own.credit[0], state.energy)


@ieee_kernel
def share_of(own, lacks, pausing, released, touching, dt):
    """The gain [1] of force and limit in this step.

    lacks     an input is missing
    pausing   there was a pause of the node before this step
    released  the device worked without torque, or does not report it
    """
    state = own.state
    missing = own.whole and lacks
    if own.replaces and not own.whole and not lacks and touching:
        own.gain.value = 0.0
    if not lacks and (pausing or own.lost):
        come_back(own)
    own.whole, own.lost = own.whole or not lacks, missing
    gain, energy, before = own.gain, state.energy, own.before
    own.before = energy
    if pausing and released:
        gain.value = 0.0
        put(state.force, (0.0, 0.0, 0.0))
    elif missing or not touching or energy > before or own.ramp == 0.0 or not own.passivity:
        step_gain(gain, not missing, dt)
    elif energy > own.least:
        gain.value = min(gain.value + dt / SETTLE, 1.0)
    elif energy < before and gain.value < 1.0:
        gain.value = max(gain.value - dt / YIELD, 0.0)
    own.outage = own.outage + dt if gain.value < 1.0 and touching else 0.0
    if own.outage > PATIENCE:
        own.least -= POWER * dt
        own.withheld = True
    own.gains.limit = gain.value * own.limit
    return gain.value


@kernel
def take_generated(own, contact):
    """Count what the body has generated as if the controller had (`physics.device.controller`, G), from the second of
    successive contacts on: what was before this node, or during an outage, did not act on the hand."""
    if contact.generated.shape[0] == 0:
        return
    total = floats(contact.generated)[0]
    if own.follows and total > own.assigned:
        own.state.made += total - own.assigned
    if total < math.inf:
        own.assigned, own.follows = total, True


@ieee_kernel
def weigh(own, wall, dt):
    """Average the contact's force and its withheld part, and set a flag if the withheld share is too large."""
    kept = (wall.law, max(wall.law - wall.line, 0.0) if wall.cut else 0.0)
    for i in range(2):
        own.steep[i] += (kept[i] - own.steep[i]) * dt / STEEP
    if own.steep[1] > MOST_WITHHELD * own.steep[0]:
        own.too_steep, own.steep_dt = True, dt


class Haptic(CompiledNode):
    """Force on the hand: free motion or contact, kept passive and within the device's limits.

    stiffness, damping   of the spring-damper in free motion (none by default: the hand moves freely)
    contact_damping      added to the contact force
    hysteresis           distance beyond the point of contact at which contact ends; one step of the device's position
    passivity            whether to limit the stiffness and add damping so that the display generates no energy
    mass, drag           of the device without the hand; they bound the stiffness and the damping
    delay                upper bound of the loop's delay in whole samples: 0 if a force acts directly after the motion
                         that it was computed from, 1 for a device that takes a command while it sends a state. Too
                         large a value is safe but lowers the stiffness
    resolution           step of the device's position; 0: exact
    limit, slew          largest force, and its largest rate of change
    ramp                 time in which the largest force is permitted again after an outage
    driven               1: another finger or a prescribed motion moves the tissue too, so that the hand may get more
                         energy than it has put in; 0: only this finger; -1: determined when the graph is loaded (0
                         without one)

    When the sender of friction disappears, friction fades out within 20 ms, and only the contact force remains. The
    force falls to zero within 4 ms while a contact, a pose, or an input of the contact's computation is missing, or
    while the device runs without the command that it had before. After that, and after a pause in which the device has
    released its motors, the force ramps up from zero: at most limit/ramp times the elapsed time and, with `passivity`,
    over 1 s while the hand rests or is pushed outward. During the recovery the display generates at most the energy
    that the hand has put in since the touch began plus 0.5 mJ; if the force is withheld for more than 0.5 s, which is
    reported, plus 10 mJ per second from then on. A late step changes the force by at most as much as a step in time. A
    node that is restarted during contact begins without force. When a ledger trips, the force falls to zero within
    `ramp` and remains zero. A contact too steep to be rendered, so that more than 5 % of its force is withheld, is
    reported once.
    """

    stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 0.0
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.0
    contact_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.0
    hysteresis: Annotated[float, "m", msgspec.Meta(ge=0)] = 60e-6
    passivity: Annotated[bool, "1"] = True
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.1
    drag: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0
    resolution: Annotated[float, "m", msgspec.Meta(ge=0), Ideal("thresholds of one count")] = 60e-6
    limit: Annotated[float, "N", msgspec.Meta(gt=0)] = 9.0
    slew: Annotated[float, "N/s", msgspec.Meta(gt=0)] = 5000.0
    ramp: Annotated[float, "s", msgspec.Meta(ge=0)] = 0.1
    driven: Annotated[int, "1", msgspec.Meta(ge=-1, le=1)] = -1

    State = {
        "gains": GAINS, "state": STATE, "past": form(Past),  # of `physics.device.controller.haptic`
        "replaces": bool,  # this node replaces an earlier one of its name
        "whole": bool, "lost": bool, "had": int, "had_device": int,  # of earlier steps; inputs as bit masks
        "pace": PACE, "gain": GAIN, "friction": FADED,
        "before": (), "least": (),  # [J] of the display: at the last step, and the least for a recovery
        "outage": (), "withheld": bool,  # [s] duration of less than the full force; whether it was long
        "assigned": (), "follows": bool,  # [J] generated by the body up to the last contact; whether there was one
        "open": (), "tripped": bool,  # remaining share of the force since the ledger tripped
        "credit": (2,), "interval": (),  # [J] least energy of this interval and the one before; its age [s]
        "steep": (2,), "too_steep": bool, "steep_dt": (),  # [N] averages of the contact's force and its withheld part
    }  # fmt: skip

    def start(self) -> None:
        super().start()
        gains = self.own["gains"]
        for name in GAINS.keys() - {"observes", "passive", "driven"}:
            gains[name] = getattr(self, name)
        gains["observes"], gains["passive"] = self.passivity or self.wants("energy"), self.passivity
        gains["driven"] = self.driven == 1
        self.hold("past", rings(self.delay))
        begin(self.own["gain"], FALL, self.ramp)
        begin(self.own["friction"]["gain"], FADE, FADE)
        self.own["least"], self.own["open"] = -LENT, 1.0

    def replaces(self) -> None:
        self.own["replaces"] = True

    @ieee_kernel
    def compute(
        own,
        contact: Annotated[
            Contact | None, Wants("normal", "force", "compression", "indentation", "lateral_force", "generated")
        ],
        friction: Annotated[Friction | None, Wants("force")],
        pose: Annotated[Pose | None, Wants("position", "velocity", "behind")],
        ledger: Annotated[Ledger | None, Wants("tripped")],
        device: Annotated[DeviceState | None, Wants("homed")],
        out: Out[Force],
        dt,
    ):
        # missing inputs, and commands that the device did not apply
        state, before = own.state, own.gain.value
        lacks = not contact.there or not pose.there
        if not lacks:
            lacks, own.had = find_lost_input(own.had, contact.present)
        if device.there:
            without, own.had_device = find_lost_input(own.had_device, device.present)
            lacks = lacks or without
            forget_credit(own, without, dt)
        else:
            without = True
        # gain of the force: falls while an input is missing, ramps up after an outage
        touching = not contact.there or contact.force > 0.0
        p = fade_value(own.friction, friction.there, friction.force, dt)
        pausing = keep_pace(own.pace, dt)
        usual = own.pace.usual
        share = share_of(own, lacks, pausing, without, touching, usual)
        if pausing:
            dt = usual  # ignore the time before the pause
        own.gains.slew = own.slew * (usual / dt) if dt > usual else own.slew
        if not contact.there or not pose.there:
            own.follows = False
            left = share / before if before > 0.0 else 0.0
            for i in range(3):
                state.force[i] = left * state.force[i]
                out.force[i] = state.force[i]
            out.state, out.energy = FREE, 0.0
            return
        own.tripped = own.tripped or (ledger.there and ledger.tripped)
        if own.tripped:  # the force falls to zero within `ramp`
            own.open = max(own.open - dt / own.ramp, 0.0) if own.ramp > 0.0 else 0.0
            own.gains.limit = min(own.gains.limit, own.open * own.limit)
            share *= own.open
        # passive force within the device's limits (physics.device.controller)
        state.withheld = 1.0 - share
        put(state.behind, gap_of(pose))
        take_generated(own, contact)
        # a surface that another finger lifts is touched above its place at rest
        a, approach = contact.lateral_force, contact.compression + max(contact.indentation, 0.0)
        rubbing = (p[0] - a[0], p[1] - a[1], p[2] - a[2])
        fx, fy, fz, held, energy = haptic(
            own.gains, state, _past_of(own.past), contact.force, vector(contact.normal), rubbing, approach,
            contact.compression, vector(pose.position), vector(pose.velocity), dt,
        )  # fmt: skip
        put(out.force, (fx, fy, fz))
        out.state, out.energy = CONTACT if held else FREE, energy
        if held and not own.too_steep:
            weigh(own, state.wall, usual)

    def notes(self) -> list[str]:
        if self.known["withheld"]:
            self._note_once(
                f"Haptic: the force on the hand was withheld for more than {PATIENCE:g} s after messages "
                "of the contact, the pose or the device were missing; it recovers slowly, so that it does not push "
                "the hand"
            )
        if self.known["too_steep"]:
            dt = float(self.own["steep_dt"])
            most = stiffest.py_func(self.mass, self.drag, self.resolution, dt * (self.delay + 0.5))
            self._note_once(
                f"Haptic: the contact is stiffer than {most:.0f} N/m, the limit of this device at this rate and "
                "delay, so the hand feels a softer one, and may oscillate by less than 1 mm under a large force. "
                "`palpate bench stability` computes the bounds"
            )
        return super().notes()
