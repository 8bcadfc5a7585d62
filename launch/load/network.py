"""Checks that the `delay` of each controller covers the network in its loop (docs/delay.md)."""

import math
from collections.abc import Iterable, Iterator

from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, Force, Pose, Proximity
from palpate.nodes.base import outputs
from palpate.nodes.base.carrier import Carrier


def unknown_delays(nodes: dict[str, NodeSpec], wires: Iterable[Wire], rate: float) -> Iterator[str]:
    """A line for each controller whose `delay` [samples] is shorter than the network between device and force [s].

    Such a controller permits a stiffness that the loop cannot show, so the force swings and gives the hand energy.
    """
    path = [w for w in wires if issubclass(w.port.type, Contact | Contacts | Proximity | Pose)]

    def late(name: str, seen: tuple[str, ...] = ()) -> float:
        """Longest time [s] that messages need on their way to a node."""
        spec = nodes[name]
        given = spec.settings if issubclass(spec.cls, Carrier) else {}
        own = (given.get("delay") or 0.0) + (given.get("jitter") or 0.0)  # None: at fault
        senders = {w.producer for w in path if w.consumer == name and w.producer in nodes} - {name, *seen}
        return own + max((late(sender, (*seen, name)) for sender in senders), default=0.0)

    for name, spec in nodes.items():
        controls = Force in outputs(spec.cls) and spec.settings.get("passivity", False)
        if not controls or "delay" not in spec.settings:
            continue
        given, needed = spec.settings["delay"] or 0, math.ceil(late(name) * rate - 1e-6)
        if given < needed:
            yield (
                f"{name}: delay: {given} samples at {rate:g} Hz, but the network makes its loop late by {needed}: the "
                f"force may swing and give the hand energy. `--set {name}.delay={needed}`"
            )
