"""The controller between the computed contact and the device (docs/equations/controller.md)."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Contact, DeviceState, Force, Friction, Ledger, Pose
from palpate.nodes.base import Node, Wants
from palpate.nodes.base.absence import FADE, FALL, Faded, Gain, Lost, Pace
from palpate.physics.device.controller import BRAKE, ENERGY, FORCE, LIMIT, MODE, SLEW, WALL, WITHHELD, buffers, haptic
from palpate.physics.device.rendered import stiffest
from palpate.physics.entry_point import entry_point

ZERO = (0.0, 0.0, 0.0)
GENTLE = 500.0  # [N/s] by which the force of the added damping rises at most after an outage, until contact ends
SETTLE = 1.0  # [s] in which the force comes back after an outage while it pushes the hand out, instead of `ramp`
LENT = 0.5e-3  # [J] of debt that the display may make after an outage before the force stops rising
STEEP = 0.25  # [s] of contact over which a force is averaged that is too steep to be shown, and what is withheld of it
MOST_WITHHELD = 0.05  # [1] of the force beyond which a note says so; people notice a change of some 7 %
YIELD = 25e-3  # [s] in which the force falls to zero again while the display gives out more than that
PATIENCE = 0.5  # [s] of withheld force after which the debt may grow, and a note says so
POWER = 10e-3  # [W] by which the debt may grow then, until all of the force is back


class Haptic(Node):
    """Force on the hand: free motion or contact, kept passive and within the device's limits.

    stiffness, damping   of the spring-damper of free motion (none by default: the hand moves freely)
    contact_damping      added to the contact force
    hysteresis           way beyond the point of contact after which contact ends; one step of the device's position
    passivity            whether stiffness is limited and damping added so that the display gives out no energy
    mass, drag           of the device, without the hand: bound that stiffness and that damping
    delay                whole samples by which the loop is late, at most: 0 for a force that acts right after the
                         motion that it was computed from, 1 for a device that takes a command while it gives a state.
                         Too large a value is safe but shows less stiffness than it could
    resolution           step of the device's position; 0: exact
    limit, slew          largest force, and its largest change over time
    ramp                 time in which the largest force is permitted again after an outage

    A friction whose sender is gone fades out within 20 ms, and the force is the contact's own alone. While a contact, a
    pose, or an input that the contact is computed from is missing, or the device works without the command that it had,
    the force falls to zero within 4 ms; after that, and after a time without steps in which the device has let go, it
    ramps up from zero, never above limit/ramp times the time since and, with `passivity`, over a second while the hand
    rests or is pushed out. It gives out no more energy than the hand has put in since the touch began, 0.5 mJ, and,
    where the force has been withheld for more than 0.5 s, which is reported, 10 mJ a second from then on. A step that
    comes late changes the force by no more than one in time. When a ledger trips the force goes to zero within
    `ramp`, and stays there. A contact that is too steep to be shown, so that more than a hundredth of its force is
    withheld, is told once.
    """

    stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 0.0
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.0
    contact_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.0
    hysteresis: Annotated[float, "m", msgspec.Meta(ge=0)] = 60e-6
    passivity: Annotated[bool, "1"] = True
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.1
    drag: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0
    resolution: Annotated[float, "m", msgspec.Meta(ge=0)] = 60e-6
    limit: Annotated[float, "N", msgspec.Meta(gt=0)] = 9.0
    slew: Annotated[float, "N/s", msgspec.Meta(gt=0)] = 5000.0
    ramp: Annotated[float, "s", msgspec.Meta(ge=0)] = 0.1

    def start(self) -> None:
        observe = self.passivity or self.wants("energy")
        given = self.stiffness, self.damping, self.contact_damping, self.hysteresis, self.mass, self.drag
        bounds = self.limit, self.slew, self.resolution
        self.gains = np.array([*given, *bounds, observe, self.passivity], dtype=float)
        self._whole = self._lost = False
        self._contact, self._device = Lost(), Lost()
        self._pace = Pace()
        self._gain, self._friction = Gain(FALL, self.ramp), Faded(FADE)
        self._energy, self._least = 0.0, -LENT
        """[J] Of the display: at the last step, and the least at which the force still comes back."""
        self._outage = 0.0
        """[s] For which less than the full force of a contact has been given."""
        self._open, self._tripped = 1.0, False
        self._steep = [0.0, 0.0]  # [N] averages of the contact's force and of what is withheld of it
        self._cautioned = self._reported = False
        self._notes = []
        self.state, self.past = buffers(self.delay)
        self._haptic = entry_point(haptic, self.gains, self.state, self.past, 0.0, *2 * (ZERO,), 0.0, *2 * (ZERO,), 0.0)

    def _come_back(self) -> None:
        """After an outage: a fresh state, but for the force that the hand has and the energy that the display has."""
        old = self.state
        self.state, self.past = buffers(self.delay)
        self.state[FORCE], self.state[ENERGY, 0], self.state[MODE, 0] = old[FORCE], old[ENERGY, 0], old[MODE, 0]
        self.state[ENERGY, BRAKE:] = old[ENERGY, BRAKE], GENTLE, 0.0
        self._least = min(old[ENERGY, 0], 0.0) - LENT

    def _share(self, lacks: bool, paused: bool, released: bool, touching: bool, dt: float) -> float:
        """The share of force and limit in this step [1].

        lacks     an input was missing
        paused    the node stood still before
        released  the device worked without torque, or does not say
        """
        missing = self._whole and lacks
        if not lacks and (paused or self._lost):
            self._come_back()
        self._whole, self._lost = self._whole or not lacks, missing
        gain, energy, before = self._gain, self.state[ENERGY, 0], self._energy
        self._energy = energy
        if paused and released:
            gain.value = 0.0
            self.state[FORCE] = 0.0
        elif missing or not touching or energy > before or self.ramp == 0.0 or not self.passivity:
            gain.update(not missing, dt)
        elif energy > self._least:
            gain.value = min(gain.value + dt / SETTLE, 1.0)
        elif energy < before and gain.value < 1.0:
            gain.value = max(gain.value - dt / YIELD, 0.0)
        self._outage = self._outage + dt if gain.value < 1.0 and touching else 0.0
        if self._outage > PATIENCE:
            self._least -= POWER * dt
            if not self._reported:
                self._report()
        self.gains[LIMIT] = gain.value * self.limit
        return gain.value

    def _report(self) -> None:
        self._reported = True
        self._notes.append(
            f"Haptic: the force on the hand was withheld for more than {PATIENCE:g} s after messages of the contact, "
            "the pose or the device were missing; it comes back slowly, so that it does not push the hand"
        )

    def _closed(self, dt: float) -> float:
        """The share of the force that is left since the ledger tripped [1]: none after `ramp`."""
        self._open = max(self._open - dt / self.ramp, 0.0) if self.ramp > 0.0 else 0.0
        self.gains[LIMIT] = min(self.gains[LIMIT], self._open * self.limit)
        return self._open

    def _caution(self, dt: float) -> None:
        self._cautioned = True
        most = stiffest.py_func(self.mass, self.drag, self.resolution, dt * (self.delay + 0.5))
        self._notes.append(
            f"Haptic: the contact rises by more than {most:.0f} N/m, the stiffest that this device can show at this "
            "rate and delay, so the hand feels a softer one, and may swing by some tenths of a millimetre where it "
            "presses hard. `palpate bench stability` computes the bounds"
        )

    def step(
        self,
        contact: Annotated[Contact | None, Wants("normal", "force", "compression", "indentation", "lateral_force")],
        friction: Annotated[Friction | None, Wants("force")],
        pose: Annotated[Pose | None, Wants("position", "velocity")],
        ledger: Annotated[Ledger | None, Wants("tripped")] = None,
        device: Annotated[DeviceState | None, Wants("homed")] = None,
        *,
        dt: float,
    ) -> Force:
        before = self._gain.value
        lacks = contact is None or pose is None or self._contact.update(contact.used)
        without = device is not None and self._device.update(device.used)
        lacks = lacks or without
        touching = contact is None or contact.force > 0.0
        p = self._friction.update(friction.force if friction is not None else None, dt)
        paused, usual = self._pace.update(dt), self._pace.usual
        share = self._share(lacks, paused, without or device is None, touching, usual)
        if paused:
            dt = usual  # what was before the pause is forgotten
        self.gains[SLEW] = self.slew * (usual / dt) if dt > usual else self.slew
        if contact is None or pose is None:
            left = share / before if before > 0.0 else 0.0
            fx, fy, fz = (left * self.state[FORCE, :3]).tolist()
            self.state[FORCE, :3] = fx, fy, fz
            return Force(force=(fx, fy, fz), state="free", energy=0.0)
        self._tripped = self._tripped or (ledger is not None and ledger.tripped)
        if self._tripped:
            share *= self._closed(dt)
        self.state[MODE, WITHHELD] = 1.0 - share
        a, approach = contact.lateral_force, contact.compression + contact.indentation
        rubbing = p[0] - a[0], p[1] - a[1], p[2] - a[2]
        fx, fy, fz, touching, energy = self._haptic(
            self.gains, self.state, self.past, contact.force, contact.normal, rubbing, approach, pose.position,
            pose.velocity, dt,
        )  # fmt: skip
        if touching and not self._cautioned:
            line, law, cut, _ = self.state[WALL].tolist()
            for i, now in enumerate((law, max(law - line, 0.0) if cut else 0.0)):
                self._steep[i] += (now - self._steep[i]) * usual / STEEP
            if self._steep[1] > MOST_WITHHELD * self._steep[0]:
                self._caution(usual)
        return Force(force=(fx, fy, fz), state="contact" if touching else "free", energy=energy)
