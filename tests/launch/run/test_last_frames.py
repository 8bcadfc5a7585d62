"""The last frames are read by a slow reader, because the sender waits for their delivery before it closes."""

import os
import threading
import time

import pytest
import zmq

from palpate.launch.run.wire import bus as bus_module
from palpate.launch.run.wire import inlet as inlet_module
from palpate.launch.run.wire.addresses import RunFolder
from palpate.launch.run.wire.bus import END, HEALTH, Bus, frame, split

RUN = f"test-{os.getpid()}"  # other processes may run these tests in parallel
FRAMES, ROOM, BEHIND = 20_000, 50, 120
LARGE = b"x" * 500


class Ends:
    """The sender and the reader of a run, and the threads of the sender."""

    def __init__(self, folder: str, real: bool):
        self.sender, self.reader = (
            Bus(RUN, name, f"ipc://{folder}/c", f"ipc://{folder}/r", real=real) for name in ("one", "other")
        )
        self.beside: list[threading.Thread] = []

    def observe(self, *topics: str) -> None:
        """Subscribe the reader to these streams of the sender, and wait until the sender knows it."""
        address = self.sender.bind(None)["observers"][0]
        self.sender.sends(["a"])
        self.reader.connect(address, ["a", *topics], observed=True, secured=False, group="one")
        self.sender.wait_linked({"a": 1, END: 1}, lambda: None)

    def start(self, target, *args) -> threading.Thread:
        self.beside.append(threading.Thread(target=target, args=args, daemon=True))
        self.beside[-1].start()
        return self.beside[-1]

    def closing(self) -> threading.Thread:
        """Close the sender gracefully in another thread."""
        return self.start(self.sender.close, True)

    def end(self) -> None:
        self.reader.context.destroy(linger=0)  # without a reader the sender ends
        for thread in self.beside:
            thread.join(5.0)
        if not any(thread.is_alive() for thread in self.beside):
            self.sender.context.destroy(linger=0)


@pytest.fixture
def ends(request, monkeypatch, tmp_path):
    """Ends with small buffers, on the simulated clock, or on the real one if the test requests it."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    for module in (bus_module, inlet_module):
        monkeypatch.setattr(module, "HIGH_WATER", ROOM)
    monkeypatch.setattr(bus_module, "QUEUED", ROOM)
    folder = RunFolder(RUN)
    made = Ends(str(tmp_path), real=getattr(request, "param", False))
    yield made
    made.end()
    folder.close()


def payload(k: int) -> bytes:
    return frame("a", b"%d " % k + LARGE)


def number(payload: bytes) -> int:
    return int(payload.split()[0])


def test_an_observer_gets_its_buffered_frames_before_the_end(ends):
    ends.observe(HEALTH, END)
    for k in range(FRAMES):
        ends.sender.keep(payload(k))
    sending = ends.closing()
    sending.join(0.5)
    assert sending.is_alive()
    seen: list[int] = []
    until = time.monotonic() + 30.0
    ended = False
    while not ended and time.monotonic() < until:
        if (data := ends.reader.overheard(wait=True)) is None:
            continue
        stream, printed = split(data)
        if stream == END:
            ends.reader.end_group(printed.decode())
            ended = True
        else:
            seen.append(number(printed))
        if len(seen) == FRAMES - BEHIND:
            sending.join(0.5)  # the rest was sent, but the buffers here are full
    assert seen == list(range(FRAMES))
    while sending.is_alive() and time.monotonic() < until:  # the leaving reader must poll its socket
        ends.reader.overheard(wait=True)
    assert not sending.is_alive()


@pytest.mark.parametrize("ends", [pytest.param(True, id="real clock")], indirect=True)
def test_an_observer_with_lost_frames_gets_the_end_marker(ends):
    """On the real clock frames without buffer space are lost, but not the end-of-stream marker."""
    ends.observe(END)
    for k in range(FRAMES):
        ends.sender.keep(payload(k))
    sending = ends.closing()
    sending.join(0.5)  # the reader has not read yet, and the connection is full
    seen, until = 0, time.monotonic() + 20.0
    while time.monotonic() < until:
        if (data := ends.reader.overheard(wait=True)) is not None:
            stream, printed = split(data)
            if stream == END:
                ends.reader.end_group(printed.decode())
                break
            seen += 1
    else:
        pytest.fail("the end-of-stream marker did not arrive")
    assert 0 < seen < FRAMES
    while sending.is_alive() and time.monotonic() < until:
        ends.reader.overheard(wait=True)
    assert not sending.is_alive()


def test_a_node_on_another_machine_gets_all_its_frames(ends):
    sender, reader = ends.sender, ends.reader
    sender._external = {"a": ("other",)}
    address = sender.bind("127.0.0.1")["force"][1]
    reader.connect(address, ["a"], observed=False, secured=False, group="one")
    inlet = reader.inlet("a")
    sender.wait_linked({}, lambda: None)

    def send() -> None:
        out = sender.sender("a", lambda: None)
        for k in range(FRAMES):
            out.send(payload(k)[2:])
        sender.close(clean_exit=True)

    sending = ends.start(send)
    seen: list[int] = []
    until = time.monotonic() + 30.0
    while len(seen) < FRAMES and time.monotonic() < until:
        if not (printed := inlet.wait()):
            continue
        seen += map(number, printed)
        if len(seen) == FRAMES - BEHIND:
            sending.join(0.5)
    assert seen == list(range(FRAMES))
    assert sending.is_alive()
    inlet.close()
    sending.join(5.0)
    assert not sending.is_alive()


def test_the_sender_does_not_wait_for_a_killed_reader(ends):
    ends.observe(END)
    ends.sender.keep(frame("a", LARGE))
    sending = ends.closing()
    sending.join(0.3)
    assert sending.is_alive()
    ends.reader.context.destroy(linger=0)
    sending.join(5.0)
    assert not sending.is_alive()


@pytest.mark.parametrize("ends", [pytest.param(True, id="real clock")], indirect=True)
def test_a_restarted_sender_waits_for_its_observers_but_not_for_those_that_have_ended(ends):
    """The observer connects after 0.1 s; the second one of this stream never does."""
    ends.sender.sends(["a"])
    address = ends.sender.bind(None)["observers"][0]

    def observe() -> None:
        time.sleep(0.1)
        ends.reader.connect(address, ["a"], observed=True, secured=False, group="one")

    ends.start(observe)
    ends.sender.wait_linked({"a": 1}, lambda: None, awaited=False)
    assert ends.sender.has_reader("a")
    begun = time.monotonic()
    ends.sender.wait_linked({"a": 2}, lambda: None, awaited=False)
    assert 1e-9 * bus_module.AGAIN_TIME <= time.monotonic() - begun < 3e-9 * bus_module.AGAIN_TIME


def test_the_sender_does_not_wait_for_external_programs(ends):
    address = ends.sender.bind(None)["observers"][0]
    ends.sender.sends(["a"])
    with zmq.Context() as context, context.socket(zmq.SUB) as stranger:
        stranger.subscribe(b"a\0")
        stranger.connect(address)
        ends.sender.wait_linked({"a": 1}, lambda: None)
        sending = ends.closing()
        sending.join(5.0)
        assert not sending.is_alive()
