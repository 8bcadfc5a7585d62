"""Reads a recording tick by tick, although the file has the messages in order of arrival."""

from collections.abc import Iterator, Mapping

import numpy as np

from palpate.records.stored import Stored


def instants(recording: Stored, present: Mapping[str, np.ndarray]) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Each tick at which one of these streams has a message, in order, with the encoded messages by stream.

    present  ticks of the messages of each stream, from `Stored.ticks`

    The number of messages per tick is known beforehand, so only messages out of order are buffered.
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
    """The last tick of all streams; 0 without messages."""
    return max((int(row[-1]) for row in present.values() if len(row)), default=0)
