"""The loop of a worker that holds observers only: a logger, a viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.launch.running.bus import HEALTH
from palpate.launch.running.clock import now
from palpate.launch.running.schedule import needed
from palpate.messages import Health, Message, MessageError, unpack

QUIET = 100_000_000  # [ns] without a frame after which, all senders being gone, none is under way any more

if TYPE_CHECKING:
    from palpate.launch.running.worker import Worker


def listen(worker: Worker) -> None:
    """Hand messages to the observers until all streams have come to their end, or the launcher has told that all
    senders are gone and no more frames come."""
    heard = now()
    while not _heard_all(worker):
        data = worker.take(block=True)
        if data:
            heard = now()
            hand_over(worker, data)
        elif data is None and worker.stopping and now() - heard > QUIET:
            return
        worker.housekeep(worker.tick)


def hand_over(worker: Worker, data: bytes) -> None:
    """Give one frame to those observers of a worker that listen to its stream."""
    topic, _, payload = data.partition(b"\0")
    stream = topic.decode(errors="replace")
    tick = -1
    try:
        if stream == HEALTH:
            told = unpack(payload, Health)
            for observer in worker.observers:
                observer.node.health(told)
        elif any(stream in observer.streams for observer in worker.observers):
            tick = unpack(payload, Message).tick
    except MessageError as error:
        worker.report({"kind": "rubbish", "stream": stream, "text": str(error)})
        return
    for observer in worker.observers:
        # A node beside the observer may have it sent a second time.
        if tick >= 0 and stream in observer.streams and tick > observer.last[stream]:
            observer.observe(stream, tick, payload)
    if not worker.slots:
        worker.tick = max(worker.tick, tick)


def _heard_all(worker: Worker) -> bool:
    """Whether every stream has brought its last message; on the real clock nobody knows which that is."""
    last = worker.last
    if last is None or worker.job.clock == "real":
        return False
    return all(
        observer.last[stream] >= needed(last, given.every, False)
        for observer in worker.observers
        for stream, given in observer.streams.items()
    )
