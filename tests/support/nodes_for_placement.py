"""Nodes of random graphs: their outputs depend on every bit of their inputs, their state and dt."""

from palpate.messages import Force, Torque
from palpate.nodes.base import Node


def mix(state: list[float], *inputs: Torque | Force | None) -> tuple[float, float, float]:
    """A bounded, chaotic function of state and inputs; updates the state."""
    for i, given in enumerate(inputs):
        for k in range(3):
            printed = -1.0 if given is None else given.torques[k] if isinstance(given, Torque) else given.force[k]
            x = state[k] + 0.37 * (i + 1) * printed + 0.1
            state[k] = x - 2.0 * round(x / 2.0)
    return state[0], state[1], state[2]


class Clock(Node):
    """The paced node."""

    paced = True
    sink = True

    def start(self) -> None:
        self.state = [0.1, 0.2, 0.3]

    def step(self, back: Torque | None, *, dt: float) -> Torque:
        return Torque(torques=mix(self.state, back, Torque(torques=(dt, dt, dt))))


class One(Node):
    """One output; the second and third input are optional."""

    def start(self) -> None:
        self.state = [0.0, 0.5, -0.5]

    def step(self, first: Torque, second: Torque | None, third: Force | None, *, dt: float) -> Torque:
        return Torque(torques=mix(self.state, first, second, third, Torque(torques=(dt, dt, dt))))


class Two(One):
    """Two outputs; the second one is unchanged at some ticks."""

    def start(self) -> None:
        super().start()
        self.sent = False

    def step(self, first: Torque, second: Torque | None, third: Force | None, *, dt: float) -> tuple[Torque, Force]:
        one = mix(self.state, first, second, third)
        same = one[0] > 0.3 and self.sent
        self.sent = True
        return Torque(torques=one), None if same else Force(force=one, state="", energy=self.state[1])  # type: ignore[return-value]
