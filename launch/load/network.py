"""Checks that the `delay` of each controller covers the network in its loop (docs/delay.md)."""

import math
from collections.abc import Iterable, Iterator

from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, Force, Pose, Proximity
from palpate.nodes.base import outputs
from palpate.nodes.base.carrier import Carrier


def unknown_delays(nodes: dict[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[str]:
    """A note for each controller whose `delay` [samples] is shorter than the delay of the network in its loop [s].

    With too short a delay the controller permits an unstable stiffness: the force oscillates and injects energy into
    the hand.
    """
    senders: dict[str, list[str]] = {name: [] for name in nodes}
    for wire in wires:
        inside = wire.producer in nodes and wire.consumer in nodes
        if inside and issubclass(wire.port.type, Contact | Contacts | Proximity | Pose):
            senders[wire.consumer].append(wire.producer)
    known: dict[str, float] = {}

    def late(name: str) -> float:
        """Largest delay [s] of the messages that reach a node; an edge that closes a loop does not count."""
        stack, visited = [name], set[str]()
        while stack:
            at = stack[-1]
            if at not in visited:
                visited.add(at)
                stack += [sender for sender in senders[at] if sender not in visited and sender not in known]
                continue
            stack.pop()
            given = nodes[at].settings if issubclass(nodes[at].cls, Carrier) else {}
            delay = (given.get("delay") or 0.0) + (given.get("jitter") or 0.0)  # None: the setting has a fault
            known[at] = delay + max((known[sender] for sender in senders[at] if sender in known), default=0.0)
        return known[name]

    for name, spec in nodes.items():
        controls = Force in outputs(spec.cls) and spec.settings.get("passivity", False)
        if not controls or "delay" not in spec.settings:
            continue
        given, needed = spec.settings["delay"] or 0, math.ceil(late(name) * rate - 1e-6)
        if given < needed:
            yield (
                f"{name}: delay: {given} samples at {rate:g} Hz, but the network delays its loop by {needed}: the "
                f"force may oscillate and inject energy into the hand. `--set {name}.delay={needed}`"
            )
