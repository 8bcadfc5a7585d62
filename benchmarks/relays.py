"""Nodes that only pass a message on: what remains is the cost of the hop."""

from palpate.messages import Torque
from palpate.nodes.base import Node


class Start(Node):
    """Sends a message round the ring."""

    paced = True
    sink = True

    def step(self, torque: Torque | None) -> Torque:
        return Torque(torques=torque.torques if torque else (1.0, 2.0, 3.0))


class Relay(Node):
    """Passes it on."""

    def step(self, torque: Torque) -> Torque:
        return Torque(torques=torque.torques)
