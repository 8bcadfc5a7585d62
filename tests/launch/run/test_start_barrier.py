"""The start of a run: no worker gets an order before it can receive it."""

import socket
import threading
import time

import msgspec
import pytest
import zmq

from palpate.engine.job import Job, NodeJob, ObserverJob
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.reports import Addressed, Close, Connect, Linked, NodesEnded, Order, Quit, Ready, Stop
from palpate.launch.run.wire.bus import Exchange


def free_port() -> int:
    """A free port whose successor is also free."""
    while True:
        with socket.socket() as one, socket.socket() as other:
            one.bind(("127.0.0.1", 0))
            port = one.getsockname()[1]
            try:
                other.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


READY = Ready({"force": ["tcp://127.0.0.1:1"], "observers": ["tcp://127.0.0.1:2"]})
END = Stop | Quit | Close  # a waiting worker ends on any of these orders


def late(port: int, group: str, orders: list[Order], seconds: float, until=Order) -> None:
    """A worker whose report `Ready` overtakes its subscription to orders; it ends after an order of these kinds."""
    with zmq.Context() as context, context.socket(zmq.PUSH) as reports, context.socket(zmq.SUB) as subscription:
        exchange = Exchange(group, repeats=True)
        reports.connect(f"tcp://127.0.0.1:{port + 1}")
        subscription.connect(f"tcp://127.0.0.1:{port}")
        reports.send(msgspec.msgpack.encode(Addressed(group, READY)))
        time.sleep(seconds)
        for topic in (group, "*"):
            subscription.subscribe(f"~{topic}".encode() + b"\0")
        while not (orders and isinstance(orders[-1], until)) and subscription.poll(60_000):
            order = exchange.take(subscription.recv())
            orders += [] if order is None else [order]
        reports.send(msgspec.msgpack.encode(Addressed(group, NodesEnded(True))))


NODES = Job("a", (NodeJob("source", "nodes_for_runs.Source", {}, 1, (), ("source",)),))
OBSERVER = Job("b", (), (ObserverJob("log", "nodes_for_runs.Slow", {}, {}),))


@pytest.fixture
def launched():
    """Start a launcher without starting its workers; returns the launcher and its port."""
    port = free_port()

    def launch(*jobs: Job, show=lambda _: None) -> Launcher:
        names = frozenset(job.group for job in jobs)
        return Launcher(jobs, joined=names, address=f"tcp://127.0.0.1:{port}", show=show)

    return port, launch


def test_a_worker_gets_its_senders_after_it_has_subscribed(launched):
    port, launch = launched
    printed: list[Order] = []
    launcher = launch(NODES)
    worker = threading.Thread(target=late, args=(port, "a", printed, 0.5))
    worker.start()
    launcher.run()
    worker.join()
    assert printed == [Connect((), {"!health": 0, "!end": 0})]


@pytest.mark.parametrize("others", [(), (NODES,)], ids=["alone", "when all nodes have ended"])
def test_a_worker_that_missed_the_stop_gets_it_after_its_subscription(launched, others):
    """Otherwise it would start and run without end, or get no order, and the run would wait for it."""
    port, launch = launched
    orders: list[Order] = []
    there = [threading.Thread(target=late, args=(port, other.group, [], 0.0)) for other in others]
    it = threading.Thread(target=late, args=(port, "b", orders, 0.2, END))

    def stop(running: Launcher) -> None:
        if not running.result.interrupted and all(running.members[o.group].state == "ready" for o in others):
            running.stop()
        if not it.ident and running._ending.over:  # its report comes after the end of the nodes
            it.start()

    launcher = launch(OBSERVER, *others, show=stop)
    for thread in there:
        thread.start()
    result = launcher.run()
    it.join()
    assert orders and isinstance(orders[-1], END)
    assert result.interrupted and not result.deaths


@pytest.mark.parametrize("report", [READY, Linked()], ids=lambda report: type(report).__name__)
def test_a_late_report_of_a_killed_worker_is_ignored(launched, report):
    """Otherwise it would count as alive, and its end as a failure of its node in a run stopped by Ctrl-C."""
    _, launch = launched
    launcher = launch(NODES)
    member = launcher.members["a"]
    member.state = "killed"
    launcher._take(member, report)
    assert member.state == "killed"
    launcher._control.sockets.close(0)
    launcher.forkserver.close()
