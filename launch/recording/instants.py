"""A recording tick by tick: what all streams say at one tick, although the file holds them as they came."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from palpate.launch.recording.reader import Recording


def instants(recording: Recording, present: Mapping[str, np.ndarray]) -> Iterator[tuple[int, dict[str, bytes]]]:
    """Each tick at which one of these streams has a message, in order, with the wire bytes by stream.

    present  of each stream at which ticks it has a message, from `Recording.ticks`

    As it is known beforehand what belongs to a tick, no more is held than lies out of order in the file.
    """
    if not present:
        return
    count = np.zeros(max(map(len, present.values())), dtype=np.int32)
    for row in present.values():
        count[: len(row)] += row
    order = iter(np.flatnonzero(count).tolist())
    due = next(order, None)
    waiting: dict[int, dict[str, bytes]] = {}
    for name, tick, _, payload in recording.raw():
        if name not in present:
            continue
        waiting.setdefault(tick, {})[name] = payload
        while due is not None and len(waiting.get(due, ())) == count[due]:
            yield due, waiting.pop(due)
            due = next(order, None)
