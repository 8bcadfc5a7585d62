"""Nodes that only forward a message, so that the time of a tick is the cost of its hops; in Python and compiled."""

from palpate.compiler.kernel import kernel
from palpate.messages import Torque
from palpate.nodes.base import Node, Out
from palpate.nodes.base.compiled import CompiledNode


class FirstRelay(Node):
    """Sends one message per tick around the ring."""

    paced = True
    sink = True

    def step(self, torque: Torque | None) -> Torque:
        return Torque(torques=torque.torques if torque else (1.0, 2.0, 3.0))


class Relay(Node):
    """Forwards the message."""

    def step(self, torque: Torque) -> Torque:
        return Torque(torques=torque.torques)


class CompiledFirstRelay(CompiledNode):
    """`FirstRelay`, compiled."""

    paced = True
    sink = True

    @kernel
    def compute(own, torque: Torque | None, out: Out[Torque], dt):
        for k in range(3):
            out.torques[k] = torque.torques[k] if torque.there else k + 1.0


class CompiledRelay(CompiledNode):
    """`Relay`, compiled."""

    @kernel
    def compute(own, torque: Torque, out: Out[Torque], dt):
        for k in range(3):
            out.torques[k] = torque.torques[k]
