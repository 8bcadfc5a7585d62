"""The controller between the computed contact and the device (docs/equations/controller.md)."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Contact, Force, Friction, Ledger, Pose
from palpate.nodes.base import Node, Wants
from palpate.physics.device.controller import LIMIT, buffers, haptic

ZERO = (0.0, 0.0, 0.0)
GAP = 9e-3
"""[s] without a step, and three times the step before, that count as an outage: the device was without torque then."""


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

    The force is zero without a contact or a pose; without a friction it is the contact's own alone. After an outage (a
    contact, a pose, an input that the contact is computed from, or the steps themselves were missing) it comes in from
    zero, never above limit/ramp times the time since, and the observer begins anew. When a ledger trips it goes to zero
    within the same time, and stays there.
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
        self.gains = np.array(
            [
                self.stiffness,
                self.damping,
                self.contact_damping,
                self.hysteresis,
                self.mass,
                self.drag,
                self.limit,
                self.slew,
                self.resolution,
                observe,
                self.passivity,
            ],
            dtype=float,
        )
        self._whole = self._lost = False
        self._last, self._since = 0.0, self.ramp
        self._open, self._tripped = 1.0, False
        self._reset()

    def _reset(self) -> None:
        self.state, self.past = buffers(self.delay)

    def _share(self, lacks: bool, dt: float) -> float:
        """The share of force and limit in this step [1]. `lacks`: an input of the contact was missing."""
        late = dt > GAP and 0.0 < 3.0 * self._last < dt
        self._lost = self._lost or late or (self._whole and lacks)
        self._last = dt
        if not lacks:
            self._whole = True
            if self._lost:
                self._lost, self._since = False, 0.0
                self._reset()
        if self._since >= self.ramp:
            return 1.0
        self._since += dt
        share = min(self._since / self.ramp, 1.0)
        self.gains[LIMIT] = share * self.limit
        return share

    def _closed(self, dt: float) -> float:
        """The share of the force that is left since the ledger tripped [1]: none after `ramp`."""
        self._open = max(self._open - dt / self.ramp, 0.0) if self.ramp > 0.0 else 0.0
        self.gains[LIMIT] = min(self.gains[LIMIT], self._open * self.limit)
        return self._open

    def step(
        self,
        contact: Annotated[Contact | None, Wants("normal", "force", "compression", "indentation", "along")],
        friction: Annotated[Friction | None, Wants("force")],
        pose: Annotated[Pose | None, Wants("position", "velocity")],
        ledger: Annotated[Ledger | None, Wants("tripped")] = None,
        *,
        dt: float,
    ) -> Force:
        if contact is None or pose is None:
            self._lost = self._whole
            self._reset()
            return Force(force=ZERO, state="free", energy=0.0)
        share = self._share(-1 in contact.used, dt)
        self._tripped = self._tripped or (ledger is not None and ledger.tripped)
        if self._tripped:
            share *= self._closed(dt)
        p, a = friction.force if friction is not None else ZERO, contact.along
        fx, fy, fz, touching, energy = haptic(
            self.gains,
            self.state,
            self.past,
            share * contact.force,
            contact.normal,
            (share * (p[0] - a[0]), share * (p[1] - a[1]), share * (p[2] - a[2])),
            contact.compression + contact.indentation,
            pose.position,
            pose.velocity,
            dt,
        )
        return Force(force=(fx, fy, fz), state="contact" if touching else "free", energy=energy)
