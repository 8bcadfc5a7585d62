"""The start of a run: nobody is told anything before he hears it."""

import socket
import threading
import time

import msgspec
import zmq

from palpate.engine.job import Job, NodeJob
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.reports import ORDERS, Addressed, Connect, NodesEnded, Order, Ready, Stop
from palpate.launch.run.wire.bus import split


def free_port() -> int:
    """A port that is free, and the next one, too."""
    while True:
        with socket.socket() as one, socket.socket() as other:
            one.bind(("127.0.0.1", 0))
            port = one.getsockname()[1]
            try:
                other.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


def late(port: int, told: list[Order], seconds: float) -> None:
    """A worker whose report that it is ready overtakes its subscription to the launcher's orders."""
    with zmq.Context() as context, context.socket(zmq.PUSH) as said, context.socket(zmq.SUB) as heard:
        said.connect(f"tcp://127.0.0.1:{port + 1}")
        heard.connect(f"tcp://127.0.0.1:{port}")
        said.send(msgspec.msgpack.encode(Addressed("b", Ready({"force": [], "observers": []}))))
        time.sleep(seconds)
        heard.subscribe(b"~b\0")
        if heard.poll(60_000):
            told.append(ORDERS.decode(split(heard.recv())[1]))
        said.send(msgspec.msgpack.encode(Addressed("b", NodesEnded(True))))


def test_a_worker_is_told_whom_to_read_when_it_can_hear_it():
    port, told = free_port(), []
    job = Job("b", (NodeJob("source", "nodes_for_runs.Source", {}, 1, (), ("source",)),))
    launcher = Launcher([job], joined=frozenset({"b"}), address=f"tcp://127.0.0.1:{port}")
    worker = threading.Thread(target=late, args=(port, told, 0.5))
    worker.start()
    launcher.run()
    worker.join()
    assert told == [Connect((), {"!health": 0, "!end": 0})]


def test_a_worker_that_was_not_there_when_the_run_was_stopped_is_told_to_end():
    """The order to quit is lost to it: it was told to begin, and the run went on without end."""
    port, told = free_port(), []
    job = Job("b", (NodeJob("source", "nodes_for_runs.Source", {}, 1, (), ("source",)),))
    worker = threading.Thread(target=late, args=(port, told, 0.1))

    def stop(running: Launcher) -> None:
        running.stop()
        if not worker.ident:
            worker.start()

    result = Launcher([job], joined=frozenset({"b"}), address=f"tcp://127.0.0.1:{port}", show=stop).run()
    worker.join()
    assert told == [Stop()] and result.interrupted and not result.deaths
