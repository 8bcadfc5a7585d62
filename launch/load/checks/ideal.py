"""Ideal hands: `hand: {ideal: true}` in a scene removes all imperfections of sensors and devices (`nodes.base.Ideal`).

With it a run has no counts of an encoder, no lost reports and no jitter, so that its results have derivatives by every
setting (docs/backwards.md). Without it the results jump by small amounts whenever a setting changes a little.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from palpate.engine.faults import Faults
from palpate.engine.graph import Graph, NodeSpec
from palpate.launch.load.files import IDEAL, Override
from palpate.launch.load.scene import Scene
from palpate.launch.load.values.settings import Offer
from palpate.messages.wording import written
from palpate.nodes.base import Ideal, settings

OPTION = f"--set scene.{'.'.join(IDEAL)}=true"


class Imperfection(NamedTuple):
    """A setting of a node with an imperfection of a sensor, by its path "device.resolution"."""

    path: str
    mark: Ideal

    def __str__(self) -> str:
        return f"{self.path} ({self.mark.about})"


def imperfections(nodes: Iterable[NodeSpec]) -> Iterator[Imperfection]:
    """The imperfections of the nodes that may run."""
    for spec in nodes:
        if spec.off is None:
            for name, mark in _marks(spec):
                if spec.settings.get(name) not in (mark.value, None):
                    yield Imperfection(f"{spec.name}.{name}", mark)


def jumps(nodes: Iterable[NodeSpec]) -> list[Imperfection]:
    """The imperfections with which results jump, so that they have no derivatives."""
    return [each for each in imperfections(nodes) if each.mark.jumps]


def describe_jumps(graph: Graph, names: Iterable[str]) -> str:
    """The imperfections of these nodes with which results jump, and what removes them; "": no such setting."""
    nodes = [graph.nodes[name] for name in names]
    found = jumps(nodes)
    if not found:
        return ""
    hand = graph.scene.get(IDEAL[0])
    ideal = isinstance(hand, dict) and hand.get(IDEAL[1]) is True  # then they are those of overrides
    single = [each for each in found if ideal or not each.mark.hand]
    cures = [OPTION] * (len(single) < len(found)) + [f"--set {each.path}={each.mark.value:g}" for each in single]
    if any(node.cls.hardware for node in nodes):
        cures = ["a graph with a simulated hand"]
    return f"results jump with {', '.join(map(str, found))}; smooth with {' '.join(cures)}"


def remove_imperfections(
    scene: Scene, nodes: Mapping[str, NodeSpec], offers: Sequence[Offer], changes: Iterable[Override], faults: Faults
) -> None:
    """If the scene asks for an ideal hand, set the marked settings of all nodes to their values without imperfection,
    except those that an override names. A fault if it is no switch, or for a device that is hardware."""
    path = ".".join(IDEAL)
    if not scene.has(path):
        return
    ideal, place = scene.get(path), scene.place(path)
    if ideal is None or isinstance(ideal, bool):
        if not ideal:
            return
    else:
        faults.add(f"{path}: found {written(ideal)}, expected true or false", "", place)
        return
    real = [spec.name for spec in nodes.values() if spec.off is None and spec.cls.hardware]
    if real:
        text = f"{path} is true, but {', '.join(real)} is hardware, whose encoder has counts"
        faults.add(text, "Leave it out, or use a graph with a simulated hand.", place)
        return
    named = {change.keys for change in changes}
    offered = {(o.node, o.key): ("scene", *o.path.split("."), o.key) for o in offers if o.taken and o.path}
    for spec in nodes.values():
        for name, mark in _marks(spec):
            given = (spec.name, name), offered.get((spec.name, name))
            if mark.hand and named.isdisjoint(given) and spec.settings.get(name) is not None:
                spec.settings[name] = mark.value


def _marks(spec: NodeSpec) -> Iterator[tuple[str, Ideal]]:
    for setting in settings(spec.cls).values():
        for mark in setting.marks:
            if isinstance(mark, Ideal):
                yield setting.name, mark
