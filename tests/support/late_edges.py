"""Shipped graphs with a `transport.Delay` on some of their edges: the forces of contact and friction, and the heights
of pins, in the same motion of the hand. The hand feels nothing, so it moves as without delays."""

import random
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.plan import plan
from palpate.messages import Message
from palpate.nodes.controller import Haptic
from palpate.stepping import Stepper

FELT = ("Contact", "Friction", "Pins")  # messages with a force on the finger, or heights of pins


class Late(NamedTuple):
    """A delay on the edge from a stream to a port of a node: delay, jitter [ms], loss [1], seed."""

    stream: str
    node: str
    port: str
    delay: float
    jitter: float
    loss: float
    seed: int


def edges(launch: LaunchFile) -> list[tuple[str, str, str]]:
    """Stream, node and port of each edge between nodes that are no observers."""
    planned = plan(launch.load())
    return [(e.stream, name, e.port) for name in planned.order for e in planned.edges[name]]


def draw(found: list[tuple[str, str, str]], random_: random.Random) -> list[Late]:
    """Delays of one to three of these edges."""
    late = []
    for edge in random_.sample(found, min(random_.choice([1, 1, 2, 3]), len(found))):
        delay = random_.choice([0, 1, 3, 10, 20, 40])
        jitter = delay * random_.choice([0, 0.3, 1])
        late.append(Late(*edge, delay, jitter, random_.choice([0, 0.1, 0.3, 0.7, 0.95]), random_.randint(0, 99)))
    return late


def node_of(stream: str) -> str:
    return stream.partition(".")[0]


def size(message: Message | None) -> float:
    """Magnitude of the force [N] or of the heights [m] of a message; None: 0."""
    return float(np.linalg.norm(getattr(message, "heights", getattr(message, "force", 0.0))))


def forces(graph: str, late: list[Late], folder: Path, sets: tuple[str, ...], ticks: int) -> dict[str, np.ndarray]:
    """Magnitudes (k) of contact force and friction [N] and of pins [m], on the simulated clock, with these delays."""
    planned = plan(find(graph).but(overrides=sets).load())
    lines = [f"extends: {graph}", *(["nodes:"] if late else [])]
    ports: dict[tuple[str, str], list[str]] = {}
    for number, each in enumerate(late):
        lines.append(
            f"  late-{number}: {{use: transport.Delay, delay: {each.delay} ms, jitter: {each.jitter} ms, "
            f"loss: {each.loss}, seed: {each.seed}, in: {{message: {each.stream}}}}}"
        )
        senders = [edge.stream for edge in planned.edges[each.node] if edge.port == each.port]
        old = ports.setdefault((each.node, each.port), senders)
        ports[each.node, each.port] = [f"late-{number}" if sender == each.stream else sender for sender in old]
    for node in {node for node, _ in ports}:
        changed = {port: senders for (own, port), senders in ports.items() if own == node}
        parts = [f"{p}: {s[0] if len(s) == 1 else '[' + ', '.join(s) + ']'}" for p, s in changed.items()]
        lines.append(f"  {node}: {{in: {{{', '.join(parts)}}}}}")
    file = folder / "late.yaml"
    file.write_text("\n".join([*lines, ""]))
    numb = [f"{name}.limit=1e-9" for name, spec in planned.graph.nodes.items() if issubclass(spec.cls, Haptic)]
    stepper = Stepper(find(str(file)).but(overrides=(*sets, *numb)))
    stepper.start()
    felt = [
        s for s, kind in planned.graph.streams.items() if kind.__name__ in FELT and node_of(s) in stepper.plan.order
    ]
    rows = [[size(tick[s]) for s in felt] for tick in (stepper.tick() for _ in range(ticks))]
    stepper.stop()
    return dict(zip(felt, np.array(rows).T, strict=True))
