"""Nodes that only forward a message, so that the time of a tick is the cost of its hops."""

from palpate.messages import Torque
from palpate.nodes.base import Node


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
