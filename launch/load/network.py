"""Checks that the `delay` of each controller covers the network in its loop (docs/delay.md), and gives energy balances
the delay of the device."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping

from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, Force, Ledger, Pose, Proximity
from palpate.nodes.base import outputs
from palpate.nodes.base.carrier import Carrier


def network_samples(nodes: Mapping[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Callable[[str], int]:
    """The largest delay [samples] by a network of the messages that reach a node, by its name."""
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

    return lambda name: math.ceil(late(name) * rate - 1e-6)


def unknown_delays(nodes: Mapping[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[str]:
    """A note for each controller whose `delay` [samples] is shorter than the delay of the network in its loop [s].

    With too short a delay the controller permits an unstable stiffness: the force oscillates and injects energy into
    the hand.
    """
    late = network_samples(nodes, wires, rate)
    for name, spec in nodes.items():
        controls = Force in outputs(spec.cls) and spec.settings.get("passivity", False)
        if not controls or "delay" not in spec.settings:
            continue
        given, needed = spec.settings["delay"] or 0, late(name)
        if given < needed:
            yield (
                f"{name}: delay: {given} samples at {rate:g} Hz, but the network delays its loop by {needed}: the "
                f"force may oscillate and inject energy into the hand. `--set {name}.delay={needed}`"
            )


def device_delays(nodes: Mapping[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[tuple[NodeSpec, int]]:
    """Each energy balance with the delay [samples] of the device whose work it counts.

    It is that of the controller that sends the force, without the network in its loop: behind a network the force
    acts as late as the device reports, on a newer motion than it was computed from.
    """
    wires = list(wires)
    late = network_samples(nodes, wires, rate)
    for name, spec in nodes.items():
        if Ledger in outputs(spec.cls) and "delay" in spec.settings:
            senders = [w.producer for w in wires if w.consumer == name and issubclass(w.port.type, Force)]
            known = [(nodes[s].settings.get("delay") or 0) - late(s) for s in senders if s in nodes]
            yield spec, max((0, *known))


def unlike_delays(nodes: Mapping[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[str]:
    """A note for each energy balance with another delay than its device, so that its `hand` is not the hand's work."""
    for spec, delay in device_delays(nodes, wires, rate):
        if (given := spec.settings["delay"]) not in (delay, None):
            yield (
                f"{spec.name}: delay: {given} samples, but the force acts {delay} samples after the motion that it was "
                f"computed from, by the delay of the controller: the work of the hand is wrong. Leave it out, or "
                f"`--set {spec.name}.delay={delay}`"
            )
