"""A recording tick by tick: what all streams say at one tick, although the file holds them as they came."""

from collections.abc import Iterator, Mapping

import numpy as np

from palpate.records.stored import Stored


def instants(recording: Stored, present: Mapping[str, np.ndarray]) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Each tick at which one of these streams has a message, in order, with the wire bytes by stream.

    present  of each stream the ticks at which it has a message, from `Stored.ticks`

    As it is known beforehand what belongs to a tick, no more is held than lies out of order in the file.
    """
    if not present:
        return
    ticks, counts = np.unique(np.concatenate(list(present.values())), return_counts=True)
    order = zip(ticks, counts, strict=True)
    due, count = next(order, (None, 0))
    waiting: dict[int, dict[str, bytes]] = {}
    for name, tick, _, payload in recording.raw():
        if name not in present:
            continue
        waiting.setdefault(tick, {})[name] = payload
        while due is not None and len(waiting.get(due, ())) == count:
            yield int(due), waiting.pop(due)
            due, count = next(order, (None, 0))


def last_tick(present: Mapping[str, np.ndarray]) -> int:
    """The last tick of them all, 0 where there is none."""
    return max((int(row[-1]) for row in present.values() if len(row)), default=0)
