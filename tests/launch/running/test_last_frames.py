"""What is sent last is read, however far behind the reader is: who closes waits until it was taken."""

from __future__ import annotations

import threading
import time

import pytest
import zmq

from palpate.launch.running import bus as bus_module
from palpate.launch.running import carrier
from palpate.launch.running.addresses import RunFolder
from palpate.launch.running.bus import END, HEALTH, Bus, frame, split

started: list[threading.Thread] = []
FRAMES, ROOM, BEHIND = 20_000, 50, 120
LARGE = b"x" * 500


@pytest.fixture
def buses(monkeypatch, tmp_path):
    """A sender and a reader of a run on the simulated clock whose outlets and inlets hold few frames."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for module in (bus_module, carrier):
        monkeypatch.setattr(module, "HIGH_WATER", ROOM)
    folder = RunFolder("test")
    made = [Bus("test", name, f"ipc://{tmp_path}/c", f"ipc://{tmp_path}/r", real=False) for name in ("one", "other")]
    yield made
    for bus in reversed(made):  # without its reader the sender ends
        for thread in started:
            thread.join(5.0 if bus is made[0] else 0.0)
        if bus is made[1] or not any(thread.is_alive() for thread in started):
            bus.context.destroy(linger=0)
    started.clear()
    folder.close()


def closes(bus: Bus) -> threading.Thread:
    """Close in order beside this thread."""
    started.append(threading.Thread(target=bus.close, args=(True,), daemon=True))
    started[-1].start()
    return started[-1]


def test_an_observer_gets_what_was_kept_for_it_before_the_end(buses):
    sender, reader = buses
    address = sender.bind(None)["observers"][0]
    sender.sends(["a"])
    reader.connect(address, ["a", HEALTH, END], observed=True, secured=False, group="one")
    sender.wait_linked({}, {"a": 1, END: 1}, lambda: None)
    for k in range(FRAMES):
        sender.keep(frame("a", b"%d " % k + LARGE))
    sending = closes(sender)
    sending.join(0.5)
    assert sending.is_alive()
    seen: list[int] = []
    until = time.monotonic() + 30.0
    ended = False
    while not ended and time.monotonic() < until:
        if (data := reader.overheard(wait=True)) is None:
            continue
        stream, payload = split(data)
        if stream == END:
            reader.ended(payload.decode())
            ended = True
        else:
            seen.append(int(payload.split()[0]))
        if len(seen) == FRAMES - BEHIND:
            sending.join(0.5)  # the rest has been sent, and there is no room for it here
    assert seen == list(range(FRAMES))
    while sending.is_alive() and time.monotonic() < until:  # who leaves has to look at its socket
        reader.overheard(wait=True)
    assert not sending.is_alive()


def test_a_node_gets_what_was_sent_to_it(buses):
    sender, reader = buses
    address = sender.bind(None)["force"][0]
    inlet = reader.inlet("a")
    reader.connect(address, ["a"], observed=False, secured=False, group="one")
    sender.wait_linked({"a": 1}, {}, lambda: None)

    def send() -> None:
        outlet = sender.zmq_outlet(lambda: None)
        for k in range(FRAMES):
            outlet.send(frame("a", b"%d " % k + LARGE))
        sender.close(orderly=True)

    started.append(sending := threading.Thread(target=send, daemon=True))
    sending.start()
    seen: list[int] = []
    until = time.monotonic() + 30.0
    while len(seen) < FRAMES and time.monotonic() < until:
        if (payload := inlet.wait()) is None:
            continue
        seen.append(int(payload.split()[0]))
        if len(seen) == FRAMES - BEHIND:
            sending.join(0.5)
    assert seen == list(range(FRAMES))
    assert sending.is_alive()
    inlet.close()
    sending.join(5.0)
    assert not sending.is_alive()


def test_who_was_killed_is_not_waited_for(buses):
    sender, reader = buses
    address = sender.bind(None)["observers"][0]
    sender.sends(["a"])
    reader.connect(address, ["a", END], observed=True, secured=False, group="one")
    sender.wait_linked({}, {"a": 1, END: 1}, lambda: None)
    sender.keep(frame("a", LARGE))
    sending = closes(sender)
    sending.join(0.3)
    assert sending.is_alive()
    reader.context.destroy(linger=0)
    sending.join(5.0)
    assert not sending.is_alive()


def test_strangers_who_listen_are_not_waited_for(buses):
    sender, _ = buses
    address = sender.bind(None)["observers"][0]
    sender.sends(["a"])
    with zmq.Context() as context, context.socket(zmq.SUB) as stranger:
        stranger.subscribe(b"a\0")
        stranger.connect(address)
        sender.wait_linked({}, {"a": 1}, lambda: None)
        sending = closes(sender)
        sending.join(5.0)
        assert not sending.is_alive()
