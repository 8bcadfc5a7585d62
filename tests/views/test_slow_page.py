"""A page that makes few frames, on a busy machine, shows the present, with all contacts in its curves."""

import os
import time

import pytest
import zmq

from palpate.launch.load.launchfile import find
from palpate.launch.run.wire.addresses import RunFolder, endpoint
from palpate.launch.run.wire.discover import Running
from palpate.messages import Contact, Pose, pack

pytest.importorskip("websockets")

from test_page import read

from palpate.views.page.feed import StreamReader
from palpate.views.page.steered import watched_part

RATE, STREAMS = 1000, 9  # [1/s] of each stream; streams of the kidney that a page reads
PAUSE, PAUSES = 1.0, 4  # [s] between two frames


def contact(tick):
    at = {"tick": tick, "time": tick * 1_000_000, "source": "contact"}
    return Contact(foot=(0.0, 0.0, 0.1), normal=(0.0, 0.0, 1.0), force=1.0, compression=1e-3, indentation=1e-3,
                   compression_rate=0.0, indentation_rate=0.0, **at)  # fmt: skip


def test_a_page_that_draws_once_in_a_second_does_not_fall_behind():
    """4 s of a run; before each frame, 1 s of all streams is unread."""
    place = RunFolder(name := f"slow-{os.getpid()}")
    touched = watched_part(find("kidney").plan())
    streams = {stream: kind for kind, stream in touched.fingers[0].items()}
    assert streams["contact"] is Contact
    pose = next(stream for stream, kind in streams.items() if kind is Pose)
    with zmq.Context() as context, context.socket(zmq.PUB) as outlet:
        outlet.set(zmq.SNDHWM, 100_000)
        outlet.set(zmq.LINGER, 0)
        outlet.bind(endpoint(name, "loop", "observers"))
        reader = StreamReader(Running(name, ["loop"]), touched)
        try:
            tick, seen = 0, []
            while not (frame := reader.frame()):  # until it is connected
                outlet.send(b"contact\0" + pack(contact(tick)))
                time.sleep(0.01)
            for _ in range(PAUSES):
                for _ in range(int(PAUSE * RATE)):
                    tick += 1
                    outlet.send(b"contact\0" + pack(contact(tick)))
                    for _ in range(STREAMS - 1):
                        outlet.send(pose.encode() + b"\0damaged")
                time.sleep(0.3)  # for the threads of ZeroMQ
                frame = reader.frame()
                head, *_ = read(frame)
                seen += head["t"]
                assert head["time"] == pytest.approx(tick * 1e-3), "the frame shows the present"
            assert len(seen) >= tick and seen == sorted(seen)
        finally:
            reader.close()
            place.close()
