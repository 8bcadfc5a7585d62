"""A hand that the program moves which steps the graph."""

from collections.abc import Sequence

import numpy as np

from palpate.messages import DeviceState, Force, Torque
from palpate.nodes.device.follower import Follower


class Steered(Follower):
    """A Falcon's grip in a simulated hand whose goal a program moves between two ticks, as `palpate.gym` does; by
    itself it stays at `begin`. Settings: those of the hand."""

    paced = True

    def start(self) -> None:
        super().start()
        self.velocity = np.zeros(3)
        self._origin = np.array(self.origin)
        self._low, self._high = np.full(3, -np.inf), np.full(3, np.inf)

    def keep_within(self, low: Sequence[float], high: Sequence[float]) -> None:
        """Let the goal stay in this box [m] (3), world frame, until the next start."""
        self._low, self._high = np.array(low) - self._origin, np.array(high) - self._origin

    def steer(self, velocity: Sequence[float]) -> None:
        """Let the goal move with this velocity [m/s] (3) from the next step on."""
        self.velocity = np.array(velocity)

    def step(self, torque: Torque | None, force: Force | None, *, dt: float) -> DeviceState:
        goal = np.minimum(np.maximum(self.goal + self.velocity * dt, self._low), self._high)
        return self.follow(goal, torque, force, 0, dt)
