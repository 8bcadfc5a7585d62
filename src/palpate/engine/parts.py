"""Assigns the nodes of a graph to fingers."""

from collections import Counter
from collections.abc import Iterable

from palpate.messages.contact import SIDES

Link = tuple[str, str, str]  # receiving node, its input, sending node
SUPPORT = "support"  # inputs for the motion of an organ, such as `first_support`, end with this


def parts(links: Iterable[Link]) -> dict[str, int]:
    """The number of the finger of each node.

    Fingers meet in nodes with several senders at one input: the body, and the node that solves their contacts. These
    nodes get no number. Without them, each finger is a connected component of the graph. Both sides of a contact of
    organs count as one input. The motion of an organ belongs to no finger.
    """
    links = [
        (receiver, SIDES[0] if port in SIDES else port, sender)
        for receiver, port, sender in links
        if not port.endswith(SUPPORT)
    ]
    senders = Counter((receiver, port) for receiver, port, _ in links)
    shared = {receiver for (receiver, _), count in senders.items() if count > 1}
    neighbours: dict[str, list[str]] = {}
    for receiver, _, sender in links:
        for one, other in ((receiver, sender), (sender, receiver)):
            if one not in shared:
                neighbours.setdefault(one, []).extend([other] if other not in shared else [])
    component: dict[str, int] = {}
    for number, begin in enumerate(neighbours):
        reached = [] if begin in component else [begin]
        for node in reached:
            if node not in component:
                component[node] = number
                reached += neighbours[node]
    return component
