"""Messages that were sent and do not come: on the simulated clock somebody would wait for them for ever.

The ways of a run keep frames whole and in order, but a way to another machine may break. Where a later message of the
stream comes, its reader sees what is missing (`Input.lost`); where none comes, because all others wait as well, only
the launcher can see that the sender is beyond it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from palpate.launch.run.member import WorkerHandle


def lost(
    members: Iterable[WorkerHandle], health: Mapping[str, Mapping[str, Any]], signs: int
) -> tuple[WorkerHandle, str] | None:
    """The sender of a message that somebody still waits for so many signs of life after it was sent, and what is to be
    told. Call it whenever all reports that have come were taken.

    health  counters of the nodes by name. A sender that has stepped but is held back by another reader may not have
            sent yet: it counts where it waits for a message itself, or has stepped once more

    A reader's signs are counted from when the sender is known to be beyond the message: before, the reader may have
    waited for long, for a sender that had much to compute.
    """
    members = list(members)
    sent = {stream: (member, node.name) for member in members for node in member.job.nodes for stream in node.streams}
    for member in members:
        if member.awaits is None:
            continue
        stream, tick = member.awaits
        sender, node = sent[stream]
        counters = health.get(node)
        if counters is None or counters["tick"] < tick + (sender.awaits is None):
            member.awaited = None
        elif member.awaited is None:
            member.awaited = 0
        elif member.awaited >= signs:
            return sender, f"its message of tick {tick} has not come to {member.names}: it was lost on its way"
    return None
