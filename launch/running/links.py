"""Who has to hear whom: what the launcher tells the workers of one another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping

from palpate.launch.running.bus import HEALTH
from palpate.launch.running.job import Job


def heard(job: Job, others: Mapping[str, Job]) -> Iterator[tuple[str, str, list[str]]]:
    """What a worker reads from the others: group, outlet and streams."""
    reads = {given.stream for node in job.nodes for given in node.inputs}
    observes = {stream for observer in job.observers for stream in observer.streams}
    for other, theirs in others.items():
        sent = {stream for node in theirs.nodes for stream in node.streams}
        for outlet, wanted in (("force", reads), ("observers", observes)):
            streams = sorted(sent & wanted)
            if outlet == "observers" and job.observers and sent:
                streams.append(HEALTH)
            if streams:
                yield other, outlet, streams


def listeners(job: Job, others: Mapping[str, Job]) -> dict[str, int]:
    """How many of the others observe each stream of a worker."""
    observed = Counter(
        stream
        for theirs in others.values()
        for stream in {stream for observer in theirs.observers for stream in observer.streams}
    )
    own = {stream: observed[stream] for node in job.nodes for stream in node.streams if observed[stream]}
    if any(node.streams for node in job.nodes):
        own[HEALTH] = sum(bool(theirs.observers) for theirs in others.values())
    return own


def inboxes(jobs: Mapping[str, Job], joined: Collection[str]) -> list[str]:
    """Which workers have an inbox: those of this machine that read what nodes of others send.

    One with observers has none: they must get a stream by one way only, or a message could overtake another.
    """
    readers = {group for job in jobs.values() for groups in job.external.values() for group in groups}
    return sorted(group for group in readers if group not in joined and not jobs[group].observers)


def muted(jobs: Collection[Job], dead: set[str]) -> set[str]:
    """Nodes that cannot go on without the dead ones, directly or through others."""
    mute: set[str] = set()
    while True:
        gone = dead | mute
        more = {
            node.name
            for job in jobs
            for node in job.nodes
            if node.name not in gone and any(g.producer in gone and not g.optional for g in node.inputs)
        }
        if not more:
            return mute
        mute |= more
