"""The loop of a worker whose nodes have ended, or that holds observers only: a logger, a viewer."""

from __future__ import annotations

from palpate.engine.clock import now
from palpate.launch.run.work.worker import Worker

QUIET = 500_000_000  # [ns] without a frame after which nothing more of senders that were killed is under way


def observe(worker: Worker, senders: set[str]) -> None:
    """Hand messages to the observers until all streams have come to their end: each has brought its last message, or
    all senders have said that they send no more. Those that were killed could not say so: after them the end is where
    no more frames come. On the real clock it is there, too, for observers next to nodes.

    senders  the groups whose nodes the observers listen to
    """
    audience, heard = worker.audience, now()
    while not audience.has_all(worker.last):
        if worker.overhear(wait=True):
            heard = now()
        elif worker.slots and worker.job.clock == "real" and now() - heard > QUIET:
            return  # others may wait for the end of the nodes here, and so say nothing more
        elif worker.stopping or audience.ended >= senders:
            left = senders - audience.ended
            if left <= audience.lost and (not left or now() - heard > QUIET):
                return
        worker.drain()
        worker.check_orders()
        worker.housekeep()
