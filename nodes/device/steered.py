"""A hand that the calling program moves between ticks."""

from collections.abc import Sequence

import numpy as np

from palpate.messages import DeviceState, Force, Torque
from palpate.nodes.base import Out
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.follower import Follower, follow


class Steered(Follower):
    """A Falcon's grip in a simulated hand whose goal a program such as `palpate.gym` moves between ticks.

    Without commands it stays at `begin`. Settings: those of the hand.
    """

    paced = True

    State = Follower.State | {"velocity": (3,), "low": (3,), "high": (3,)}
    """Velocity [m/s] of the goal and corners of its box [m], in the device's frame."""

    def start(self) -> None:
        super().start()
        self.own["low"], self.own["high"] = -np.inf, np.inf

    def keep_within(self, low: Sequence[float], high: Sequence[float]) -> None:
        """Limit the goal to a box [m] (3), world frame, until the next start."""
        self.own["low"], self.own["high"] = np.subtract(low, self.origin), np.subtract(high, self.origin)

    def steer(self, velocity: Sequence[float]) -> None:
        """Set the velocity [m/s] (3) of the goal from the next step on."""
        self.own["velocity"] = velocity

    @kernel
    def compute(own, torque: Torque | None, force: Force | None, out: Out[DeviceState], dt):
        p, v, low, high = own.goal, own.velocity, own.low, own.high
        goal = (
            min(max(p[0] + v[0] * dt, low[0]), high[0]),
            min(max(p[1] + v[1] * dt, low[1]), high[1]),
            min(max(p[2] + v[2] * dt, low[2]), high[2]),
        )
        follow(own, goal, torque, force, out, dt)
