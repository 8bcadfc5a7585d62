"""The loop of a worker that holds observers only: a logger, a viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.launch.running.schedule import needed
from palpate.messages import Message, unpack

if TYPE_CHECKING:
    from palpate.launch.running.worker import Worker


def listen(worker: Worker) -> None:
    """Hand messages to the observers until all streams have come to their end, or the launcher has stopped the
    worker and no more frames come."""
    while not _heard_all(worker):
        data = worker.take(block=True)
        if data:
            topic, _, payload = data.partition(b"\0")
            stream = topic.decode()
            worker.tick = unpack(payload, Message).tick
            for observer in worker.observers:
                if stream in observer.streams:
                    observer.observe(stream, worker.tick, payload)
        elif data is None and worker.stopping:
            return
        worker.housekeep(worker.tick)


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
