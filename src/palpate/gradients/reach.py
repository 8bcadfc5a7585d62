"""Numbers of list settings that a touch cannot reach, such as places of a map where no finger presses.

Their derivative is exactly 0, so they need no lane. A node that knows which of its numbers a load reaches has a method
`out_of_reach(setting, feet)`. What it says is checked: one lane moves all these numbers at once, by different amounts,
and must have the same bits as the lane that moves nothing. Otherwise all numbers get their lanes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.engine.graph import Graph
from palpate.gradients.parameters import Parameter
from palpate.messages import Contact, Load

FEW = 4  # numbers of one setting below which it does not pay to find out


class Reach:
    """Which parameters the touches of the lanes cannot reach.

    keep  fields that show where the fingers press; empty: no node knows
    """

    def __init__(self, graph: Graph, parameters: Sequence[Parameter]) -> None:
        self._graph, self._places, self.keep = graph, dict[str, list[int]](), list[str]()
        targets: dict[str, list[int]] = {}
        for place, each in enumerate(parameters):
            if each.node and len(each.inside) == 1 and hasattr(graph.nodes[each.node].cls, "out_of_reach"):
                targets.setdefault(each.target, []).append(place)
        self._parameters = parameters
        for target, places in targets.items():
            streams = _contacts(graph, target.partition(".")[0])
            if len(places) >= FEW and streams:
                self._places[target] = places
                self.keep += [f"{stream}.{name}" for stream in streams for name in ("foot", "force")]
        self.keep = list(dict.fromkeys(self.keep))

    def unreached(self, columns: Mapping[str, np.ndarray]) -> list[int]:
        """The parameters that a touch cannot reach, from the kept fields (rows, ...) of its lane."""
        found: list[int] = []
        for target, places in self._places.items():
            name, _, setting = target.partition(".")
            spec = self._graph.nodes[name]
            feet = [
                columns[f"{stream}.foot"][columns[f"{stream}.force"] != 0.0] for stream in _contacts(self._graph, name)
            ]
            body: Any = spec.cls(**spec.settings)
            away = body.out_of_reach(setting, np.unique(np.concatenate(feet), axis=0))
            found += [place for place in places if away[self._parameters[place].inside[0]]]
        return found


def _contacts(graph: Graph, body: str) -> list[str]:
    """The contacts whose forces are spread over a body; [] if one of its loads has none."""
    found: list[str] = []
    for edge in graph.nodes[body].edges:
        if issubclass(graph.streams[edge.stream], Load):
            spreading = graph.nodes[edge.producer].edges
            mine = [each.stream for each in spreading if issubclass(graph.streams[each.stream], Contact)]
            if not mine:
                return []
            found += mine
    return found
