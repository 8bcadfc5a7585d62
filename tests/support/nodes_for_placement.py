"""Nodes of random graphs: their outputs depend on every bit of their inputs, their state and dt."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.messages import Force, Torque
from palpate.nodes.base import Node, Out
from palpate.nodes.base.compiled import CompiledNode


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
        return Torque(torques=one), None if same else Force(force=one, state="free", energy=self.state[1])  # type: ignore[return-value]


@kernel
def stir(state, place, given):
    """`mix` with one input of three numbers."""
    for k in range(3):
        x = state[k] + 0.37 * (place + 1) * given[k] + 0.1
        state[k] = x - 2.0 * np.rint(x / 2.0)


@kernel
def stir_number(state, place, given):
    """`mix` with a number in place of three."""
    for k in range(3):
        x = state[k] + 0.37 * (place + 1) * given + 0.1
        state[k] = x - 2.0 * np.rint(x / 2.0)


class CompiledClock(CompiledNode):
    """The paced node."""

    paced = True
    sink = True
    State = {"state": (3,)}

    def start(self) -> None:
        super().start()
        self.own["state"] = 0.1, 0.2, 0.3

    @kernel
    def compute(own, back: Torque | None, out: Out[Torque], dt):
        if back.there:
            stir(own.state, 0, back.torques)
        else:
            stir_number(own.state, 0, -1.0)
        stir_number(own.state, 1, dt)
        for k in range(3):
            out.torques[k] = own.state[k]


class CompiledOne(CompiledNode):
    """One output; the second and third input are optional."""

    State = {"state": (3,)}

    def start(self) -> None:
        super().start()
        self.own["state"] = 0.0, 0.5, -0.5

    @kernel
    def compute(own, first: Torque, second: Torque | None, third: Force | None, out: Out[Torque], dt):
        stir(own.state, 0, first.torques)
        if second.there:
            stir(own.state, 1, second.torques)
        else:
            stir_number(own.state, 1, -1.0)
        if third.there:
            stir(own.state, 2, third.force)
        else:
            stir_number(own.state, 2, -1.0)
        stir_number(own.state, 3, dt)
        for k in range(3):
            out.torques[k] = own.state[k]


class CompiledTwo(CompiledNode):
    """Two outputs."""

    State = {"state": (3,)}

    @kernel
    def compute(
        own, first: Torque, second: Torque | None, third: Force | None, out: Out[Torque], force: Out[Force], dt
    ):
        stir(own.state, 0, first.torques)
        if second.there:
            stir(own.state, 1, second.torques)
        if third.there:
            stir(own.state, 2, third.force)
        stir_number(own.state, 3, dt)
        for k in range(3):
            out.torques[k] = own.state[k]
            force.force[k] = -own.state[k]
        force.energy = own.state[0]
