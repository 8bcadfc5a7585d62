"""The simulated hands of a graph, and what each of them feels."""

from dataclasses import dataclass

from palpate.engine.graph import Graph
from palpate.engine.plan import Plan
from palpate.messages import Contact, Force, Friction, Message, Pose
from palpate.nodes.device import Simulated
from palpate.physics.errors import ArgumentError


@dataclass(frozen=True)
class Hand:
    """One hand: its device, and the streams that its controller hears. `friction` is None where the graph has none."""

    device: str
    pose: str
    contact: str
    friction: str | None


def simulated(graph: Graph) -> list[str]:
    """The nodes that are simulated hands. ArgumentError: there is none."""
    names = [name for name, spec in graph.nodes.items() if issubclass(spec.cls, Simulated)]
    if not names:
        sources = ", ".join(f"{name} ({spec.use})" for name, spec in graph.nodes.items() if spec.cls.paced)
        raise ArgumentError(
            f"{graph.path.stem}: no simulated hand to steer; sources: found {sources or 'none'}, expected "
            "device.Simulated. Try kidney, nodule, organs or pinch"
        )
    return names


def hand(plan: Plan, device: str) -> Hand:
    """What a device's hand feels: the inputs of the controller that answers it. ArgumentError: nothing answers it."""
    queue = [edge.producer for edge in plan.edges[device]]
    for name in queue:
        if Force in plan.graph.nodes[name].streams.values():
            heard = {edge.stream: plan.graph.streams[edge.stream] for edge in plan.edges[name]}
            streams = [_first(heard, kind) for kind in (Pose, Contact, Friction)]
            if streams[0] is not None and streams[1] is not None:
                return Hand(device, streams[0], streams[1], streams[2])
            break
        queue += [edge.producer for edge in plan.edges[name] if edge.producer not in queue]
    raise ArgumentError(
        f"{plan.graph.path.stem}: no force comes back to {device!r}; expected a controller that hears a Contact and a "
        "Pose, as controller.Haptic does in the graph kidney"
    )


def _first(heard: dict[str, type[Message]], kind: type[Message]) -> str | None:
    return next((stream for stream, sent in heard.items() if issubclass(sent, kind)), None)
