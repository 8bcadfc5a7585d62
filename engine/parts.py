"""Which nodes of a graph belong to one finger."""

from collections import Counter
from collections.abc import Iterable

Link = tuple[str, str, str]  # the node that hears, its input, and the node that sends


def parts(links: Iterable[Link]) -> dict[str, int]:
    """A number for each node: those of one number hang together.

    Fingers meet in nodes with an input that several send to: in the body, in what solves their contacts together. With
    these left out, which get no number, a finger is what hangs together.
    """
    links = list(links)
    count = Counter((hears, port) for hears, port, _ in links)
    shared = {hears for (hears, _), senders in count.items() if senders > 1}
    near: dict[str, list[str]] = {}
    for hears, _, sends in links:
        for one, other in ((hears, sends), (sends, hears)):
            if one not in shared:
                near.setdefault(one, []).extend([other] if other not in shared else [])
    found: dict[str, int] = {}
    for number, begin in enumerate(near):
        reached = [] if begin in found else [begin]
        for node in reached:
            if node not in found:
                found[node] = number
                reached += near[node]
    return found
