"""Orders and reports arrive once and in order, also if the connection to another machine breaks and returns."""

import contextlib
import select
import socket
import threading
import time

import msgspec
import pytest
from test_start_barrier import NODES, free_port

from palpate.launch.run.reports import Alive, Beat, Close, End, Gone, Linked, NodesEnded, Observes, Quit, Stop
from palpate.launch.run.wire.bus import Bus, Exchange
from palpate.launch.run.wire.wires import ControlChannel, ControlSockets


class Cable:
    """A connection to a port that can be cut: both ends see it close."""

    def __init__(self, port: int) -> None:
        self.listener, self.target, self.plugged = socket.create_server(("127.0.0.1", 0)), port, True
        self.port = self.listener.getsockname()[1]
        self.pairs: list[tuple[socket.socket, socket.socket]] = []
        self.ended = False
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while not self.ended:
            ends = [end for pair in self.pairs for end in pair]
            ready = select.select([self.listener, *ends], [], [], 0.01)[0]
            for end in ready:
                with contextlib.suppress(OSError, ValueError):
                    if end is self.listener:
                        here = end.accept()[0]
                        if self.plugged:
                            self.pairs.append((here, socket.create_connection(("127.0.0.1", self.target))))
                        else:
                            here.close()
                        continue
                    pair = next((pair for pair in self.pairs if end in pair), None)
                    if pair is None:  # dropped with its other end
                        continue
                    data = end.recv(65536) if self.plugged else b""
                    if data:
                        pair[1 - pair.index(end)].sendall(data)
                    else:
                        self._drop(pair)
            if not self.plugged:
                for pair in tuple(self.pairs):
                    self._drop(pair)

    def _drop(self, pair: tuple[socket.socket, socket.socket]) -> None:
        self.pairs.remove(pair)
        for end in pair:
            end.close()

    def cut(self) -> None:
        self.plugged = False
        until = time.monotonic() + 5.0
        while self.pairs and time.monotonic() < until:
            time.sleep(0.005)


@pytest.fixture
def ends():
    """The launcher's side, the worker's side, and the two cables between them."""
    port = free_port()
    channel = ControlChannel(ControlSockets("broken", f"tcp://127.0.0.1:{port}", None), {"a": NODES})
    cables = Cable(port), Cable(port + 1)
    bus = Bus("broken", "a", *(f"tcp://127.0.0.1:{cable.port}" for cable in cables), real=True, local=False)
    yield channel, bus, cables
    for cable in cables:
        cable.ended = True
        cable.listener.close()
    bus.context.destroy(linger=0)
    channel.sockets.close(0)


def exchange(channel, bus, received, reported, enough, seconds=10.0):
    """Serve both sides, with heartbeats of the launcher, until `enough`."""
    until, beat = time.monotonic() + seconds, 0.0
    while not enough() and time.monotonic() < until:
        channel.deliver()
        if time.monotonic() - beat > 0.1:
            beat = time.monotonic()
            channel.send_order("a", Beat(channel.received["a"], 0))
        order = bus.order(5)
        received += [] if order is None or isinstance(order, Beat) else [order]
        while channel.sockets.has_report():
            addressed = channel.report()
            reported += [] if addressed is None else [addressed.report]


def test_orders_during_an_outage_arrive_afterwards_once_and_in_order(ends):
    channel, bus, cables = ends
    received, reported = [], []
    channel.send_order("a", Gone(("x",), ()))
    exchange(channel, bus, received, reported, lambda: received)
    cables[0].cut()
    channel.send_order("a", Stop())
    channel.send_order("a", End(7))
    cables[0].plugged = True
    exchange(channel, bus, received, reported, lambda: len(received) == 3)
    channel.send_order("a", Close())
    exchange(channel, bus, received, reported, lambda: len(received) == 4)
    exchange(channel, bus, received, reported, lambda: False, seconds=0.3)
    assert received == [Gone(("x",), ()), Stop(), End(7), Close()]


def test_reports_lost_in_an_outage_are_sent_again_once_and_in_order(ends):
    channel, bus, cables = ends
    received, reported = [], []
    bus.report(Linked())
    exchange(channel, bus, received, reported, lambda: reported)
    # A report in transit: taken from the socket of the launcher, as if it had not arrived.
    bus.report(Observes())
    assert channel.sockets.has_report(5000)
    channel.sockets.report()
    cables[1].cut()
    bus.report(NodesEnded(True))
    cables[1].plugged = True
    exchange(channel, bus, received, reported, lambda: len(reported) == 3)
    exchange(channel, bus, received, reported, lambda: False, seconds=0.5)
    assert reported == [Linked(), Observes(), NodesEnded(True)]


def test_only_the_next_order_is_taken_and_heartbeats_always():
    taken = Exchange("a", repeats=True)

    def take(number, order):
        return taken.take(b"~a\0%d %b" % (number, msgspec.json.encode(order)))

    assert take(2, Quit()) is None and take(1, Stop()) == Stop() and take(1, Stop()) is None
    assert take(0, Beat(3, 0)) == Beat(3, 0) and take(3, Close()) is None and take(2, Quit()) == Quit()


def test_a_report_is_sent_again_from_the_second_heartbeat_on():
    sent = Exchange("a", repeats=True)
    first, second = sent.write(Linked()), sent.write(Observes())
    assert sent.lost(0) == []  # it may be on its way
    assert sent.lost(1) == [second] and sent.lost(0) == [second]
    assert sent.lost(2) == []
    sent.write(Alive({}))
    assert sent.lost(2) == [] == sent.lost(2)
    assert first != second


def test_a_worker_of_this_machine_keeps_no_reports():
    sent = Exchange("a", repeats=False)
    sent.write(Linked())
    assert sent.lost(0) == [] == sent.lost(0)
