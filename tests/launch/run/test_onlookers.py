"""External programs never block a run: they lose messages that they do not read, and the losses are reported."""

import os
import select
import signal
import subprocess
import sys
import threading
import time

import pytest
import zmq
from graphs_for_runs import GRAPH, NODES, write_graph

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.launch.run.wire import outlet as outlet_module
from palpate.launch.run.wire.addresses import RunFolder, endpoint
from palpate.launch.run.wire.bus import END, Bus, frame, split
from palpate.records.reader import Recording

RUN = f"onlookers-{os.getpid()}"
LOOKS_ON = """
import sys, time, zmq
socket = zmq.Context().socket(zmq.SUB)
socket.set(zmq.RCVHWM, 100)
socket.subscribe(b"")
for address in sys.argv[2:]:
    socket.connect(address)
print(socket.recv()[:1].decode(), flush=True)
while sys.argv[1] != "never":
    time.sleep(float(sys.argv[1]))
    socket.recv()
time.sleep(1000)
"""
"""A pyzmq program that reads one message, and then none or one after each pause [s]."""


@pytest.fixture(params=[False, True], ids=["simulated", "real"])
def bus(request, monkeypatch, tmp_path):
    """The sockets of a worker whose stream `a` no node of the run reads; it may block for at most 100 polls."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(outlet_module, "QUEUE", 1 << 18)
    folder = RunFolder(RUN)
    made = Bus(RUN, "one", f"ipc://{tmp_path}/c", f"ipc://{tmp_path}/r", real=request.param)
    made.bind(None)
    made.sends(["a"])
    made.wait_linked({}, lambda: None)
    yield made
    made.context.destroy(linger=0)
    folder.close()


class Held:
    """Counts the polls of a blocked sender."""

    looks = 0

    def __call__(self):
        self.looks += 1
        assert self.looks < 100, "an external program blocks the run"


def onlooker(how, *addresses):
    return subprocess.Popen([sys.executable, "-c", LOOKS_ON, how, *addresses], stdout=subprocess.PIPE, text=True)


def until(bus, condition):
    for _ in range(60_000):
        bus.sweep()
        if condition():
            return
        time.sleep(0.001)
    raise AssertionError("the condition did not become true")


def send(bus, count, first=0, held=None):
    for k in range(first, first + count):
        bus.keep(frame("a", b"%d " % k + b"x" * 400))
        if not k % 16:
            bus.sweep()
            bus.flush(held or Held())
    bus.flush(held or Held())


@pytest.mark.parametrize("how", ["never", "0.005", "stopped"])
def test_a_slow_program_loses_counted_messages_and_blocks_no_one(bus, how):
    """A second program, which reads, gets all messages."""
    count, held, seen = 20_000, Held(), []
    process = onlooker("0" if how == "stopped" else how, endpoint(RUN, "one", "observers"))
    good = zmq.Context()
    with process, good, good.socket(zmq.SUB) as reader:
        try:
            reader.set(zmq.RCVHWM, 0)
            reader.subscribe(b"a\0")
            reader.connect(endpoint(RUN, "one", "observers"))
            until(bus, lambda: len(bus._public._readers) == 2 and all(r.topics for r in bus._public._readers))
            assert bus.update_listeners() and bus.has_reader("a")
            bus.keep(frame("a", b"-1 "))
            bus.flush(held)
            until(bus, lambda: select.select([process.stdout], [], [], 0)[0])
            if how == "stopped":
                process.send_signal(signal.SIGSTOP)
            for first in range(0, count, 200):
                send(bus, 200, first, held)
                while len(seen) < first + 201 and reader.poll(60_000):
                    seen.append(int(split(reader.recv())[1].split()[0]))
                    bus.sweep()
        finally:
            process.kill()
        assert held.looks == 0
        assert seen == list(range(-1, count)), "the reading program loses nothing"
        assert max(reader.queued for reader in bus._public._readers) <= 1 << 18
        (note,) = bus._public.notes()
        lost = int(note.split()[0])
        assert 0 < lost < count
        assert note == f"{lost} messages of group 'one' were dropped: the buffer of process {process.pid} was full"


def test_only_whole_messages_are_lost_and_the_others_arrive_in_order(bus):
    with zmq.Context() as context, context.socket(zmq.SUB) as reader:
        reader.set(zmq.RCVHWM, 1)
        reader.subscribe(b"a\0")
        reader.connect(endpoint(RUN, "one", "observers"))
        until(bus, lambda: any(r.topics for r in bus._public._readers))
        (connection,) = bus._public._readers
        send(bus, 10_000)
        lost, seen = connection.dropped, []
        assert 0 < lost < 10_000
        bus.keep(frame("a", b"10000 "))  # a message that fills the queue is not lost later
        until(bus, lambda: reader.poll(0))
        while reader.poll(200):
            stream, data = split(reader.recv())
            number, rest = data.split(b" ")
            assert stream == "a" and rest in (b"", b"x" * 400)
            seen.append(int(number))
            bus.sweep()
            bus.flush(Held())
    assert seen == sorted(seen) and len(set(seen)) == len(seen) == 10_001 - connection.dropped


def test_a_message_larger_than_the_queue_arrives_whole(bus):
    large = frame("a", os.urandom(3 << 20))
    with zmq.Context() as context, context.socket(zmq.SUB) as reader:
        reader.subscribe(b"a\0")
        reader.connect(endpoint(RUN, "one", "observers"))
        until(bus, lambda: any(r.topics for r in bus._public._readers))
        bus.keep(large)
        bus.flush(Held())
        until(bus, lambda: reader.poll(0))
        assert reader.recv() == large


def test_at_the_end_a_reader_gets_the_queue_and_the_end_marker(bus):
    got = []

    def read():
        with zmq.Context() as context, context.socket(zmq.SUB) as reader:
            reader.subscribe(b"")
            reader.connect(endpoint(RUN, "one", "observers"))
            while not got or got[-1] != END:
                got.append(split(reader.recv())[0])

    thread = threading.Thread(target=read)
    thread.start()
    until(bus, lambda: any(r.topics for r in bus._public._readers))
    for k in range(600):
        bus.keep(frame("a", b"%d" % k + bytes(400)))
    bus.close(clean_exit=True)
    thread.join(30.0)
    assert got == ["a"] * 600 + [END]


def test_on_the_real_clock_a_poll_serves_at_most_one_new_client(bus):
    """With 45 clients at once, each is served in the end, and each poll of the sockets serves at most one."""
    with zmq.Context() as context:
        readers = [context.socket(zmq.SUB) for _ in range(45)]
        for reader in readers:
            reader.subscribe(b"a\0")
            reader.connect(endpoint(RUN, "one", "observers"))
        known, served = bus._public._readers, []
        serve, accept = bus._public._serve, bus._public._accept
        bus._public._serve = lambda reader: (served.append(1), serve(reader))
        bus._public._watch.remove(bus._public._listener.fileno())
        bus._public._watch.add(bus._public._listener.fileno(), lambda: (served.append(1), accept()))
        for _ in range(60_000):
            before = len(served)
            bus.sweep()
            assert not bus.real or len(served) - before <= 1
            if len(known) == 45 and all(reader.topics for reader in known):
                break
            time.sleep(0.001 if len(served) == before else 0.0)
        assert len(served) >= 3 * 45
        for reader in readers:
            reader.close(linger=0)
        until(bus, lambda: not known)
    assert bus._public.notes() == []


@pytest.mark.parametrize("outlet", ["observers", "force"])
def test_a_simulated_run_continues_with_a_complete_recording(tmp_path, outlet):
    graph = write_graph(tmp_path, f"rate: 1000\n{GRAPH}")
    procs: list[subprocess.Popen] = []

    def watch(launcher):
        if launcher.phase == "running" and not procs:
            addresses = [endpoint(launcher.run_id, name, outlet) for name in NODES]
            procs.append(onlooker("never", *addresses))

    file = tmp_path / "run.mcap"
    launch = LaunchFile(graph=graph, duration=3.0, record=file, clock="simulated", pace=1.0)
    outcome = execute(launch, watch=watch)
    for process in procs:
        process.kill()
        process.communicate()
    assert outcome.ok and outcome.result.ticks == 3000
    assert Recording(file).complete


@pytest.mark.long
@pytest.mark.parametrize("place", [None, "two"])
def test_a_program_that_never_reads_does_not_block_a_long_simulated_run(tmp_path, place):
    """The run has more messages than libzmq would queue. In the grouped case the processes with nodes do not record."""
    graph = write_graph(tmp_path, f"rate: 1000\n{GRAPH}")
    groups = tmp_path / "place.yaml"
    groups.write_text("a: {nodes: [source, spring, drag]}\nb: {nodes: [spread, sum]}\n")
    procs: list[subprocess.Popen] = []
    left, looked = 300.0, time.monotonic()

    def watch(launcher):
        nonlocal left, looked
        moment = time.monotonic()
        left, looked = left - min(moment - looked, 0.2), moment
        if launcher.phase == "running" and not procs:
            addresses = [endpoint(launcher.run_id, group, "observers") for group in launcher.members if group != "log"]
            procs.append(onlooker("never", *addresses))
        if left < 0.0:
            launcher.stop()

    launch = LaunchFile(graph=graph, duration=30.0, clock="simulated", place=groups if place else None)
    outcome = execute(launch, watch=watch)
    for process in procs:
        process.kill()
        process.communicate()
    assert outcome.ok and outcome.result.ticks == 30_000
