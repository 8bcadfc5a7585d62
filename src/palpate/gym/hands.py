"""The hands of an environment: limits of their motion and of observations, and where they are in a graph."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from palpate.engine.graph import Graph
from palpate.engine.plan import Plan
from palpate.messages import Contact, Force, Friction, Pose
from palpate.nodes.device import Simulated
from palpate.physics.errors import ArgumentError

SPEED = 0.25
"""[m/s] at most of the hand's goal along each axis."""
ROOM = ((-0.03, -0.03, -0.025), (0.03, 0.03, 0.005))
"""[m] (2,3) Lower and upper corner of the box of the goal, relative to the start of the hand."""
BOUNDS = {"position": 0.2, "velocity": 5.0, "force": 50.0}
"""Limit of each part of the observation [m], [m/s], [N] along each axis; larger values are clipped."""

Changes = dict[str, dict[str, Any]]
"""Settings by node and name."""


class Hand(NamedTuple):
    """One hand: its device and the input streams of its controller; `friction`: None without one."""

    device: str
    pose: str
    contact: str
    friction: str | None


def simulated_hands(graph: Graph) -> list[str]:
    """Names of the nodes that are simulated hands. ArgumentError: the graph has none."""
    names = [name for name, spec in graph.nodes.items() if issubclass(spec.cls, Simulated)]
    if not names:
        sources = ", ".join(f"{name} ({spec.use})" for name, spec in graph.nodes.items() if spec.cls.paced)
        raise ArgumentError(
            f"{graph.path.stem}: no simulated hand to steer; sources: found {sources or 'none'}, expected "
            "device.Simulated. Try kidney, nodule, organs or pinch"
        )
    return names


def hand_of(plan: Plan, device: str) -> Hand:
    """The hand of a device: the inputs of the controller that commands its force. ArgumentError: without one."""
    queue = [edge.producer for edge in plan.edges[device]]
    for name in queue:
        if Force in plan.graph.nodes[name].streams.values():
            inputs = {edge.stream: plan.graph.streams[edge.stream] for edge in plan.edges[name]}
            pose, contact, friction = (
                next((stream for stream, sent in inputs.items() if issubclass(sent, kind)), None)
                for kind in (Pose, Contact, Friction)
            )
            if pose and contact:
                return Hand(device, pose, contact, friction)
            break
        queue += [edge.producer for edge in plan.edges[name] if edge.producer not in queue]
    raise ArgumentError(
        f"{plan.graph.path.stem}: {device!r} receives no force; expected a controller with a Contact and a Pose as "
        "inputs, such as controller.Haptic in the graph kidney"
    )


def within(numbers: Iterable[float], most: float) -> list[float]:
    """Numbers limited to -`most` to `most`."""
    return [min(max(number, -most), most) for number in numbers]
