"""A logger that is too slow or stopped: what it did not receive is counted per stream, at the end of a run too, and the
frames that wait for it take bounded memory."""

import os
import random
import threading
import time

import numpy as np
import pytest
from graphs_for_runs import write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine.job import Job, ObserverJob, StreamJob
from palpate.engine.slot import Output
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.launch.run.wire import bus as bus_module
from palpate.launch.run.wire.addresses import RunFolder
from palpate.launch.run.wire.audience import Audience
from palpate.launch.run.wire.bus import END, HEALTH, Bus, frame
from palpate.launch.run.wire.parcels import LONGEST
from palpate.messages import Health, Torque, pack
from palpate.nodes.base import Block
from palpate.nodes.base.block import ENTRY, MARGIN
from palpate.records.format.mcap_file import lacking
from palpate.records.reader import Recording

RUN = f"slow-{os.getpid()}"
STEPS, TICKS_OF_HEALTH = 6000, 200
PARCELS = 50
BOUND = PARCELS * LONGEST  # [bytes]
AHEAD = bus_module.AHEAD * LONGEST  # [bytes] that the logger itself buffers
KERNEL = 1_000_000  # [bytes] of the buffers of a Unix socket, roughly
LONG = "x" * 1000  # a name, which makes messages long


def torque(tick: int) -> bytes:
    sent = Torque(torques=(1.0, 2.0, float(tick)), tick=tick, time=tick * 1_000_000, source=LONG, used=(tick,))
    return frame("node", pack(sent))


def health(steps: int) -> bytes:
    numbers = dict.fromkeys(("since", "late", "lost", "held"), 0)
    times = dict.fromkeys(("median", "p99", "longest", "age"), 1e-6)
    return pack(Health(tick=steps - 1, time=0, source="node", used=(), steps=steps, state="ready", **numbers, **times))


class Group:
    """A worker of a run on the real clock that sends, and a logger that reads it, without processes."""

    def __init__(self, folder: str, record: str) -> None:
        self.sender, self.reader = (
            Bus(RUN, name, f"ipc://{folder}/c", f"ipc://{folder}/r", real=True) for name in ("nodes", "log")
        )
        stream = StreamJob("palpate.messages.device.Torque", "node")
        observer = ObserverJob("log", "palpate.nodes.logger.Mcap", {"path": record}, {"node": stream})
        about = {"clock": "real", "plan": {"rate": 1000.0}}
        self.audience = Audience(Job("log", (), (observer,), clock="real", about=about), self.reader.end_group)
        self.audience.start(self.audience.slots[0], {})
        address = self.sender.bind(None)["observers"][0]
        self.sender.sends(["node"])
        self.reader.connect(address, ["node", HEALTH, END], observed=True, secured=False, group="nodes")
        self.sender.wait_linked({"node": 1, END: 1}, lambda: None)
        self.received = 0  # [bytes]

    def read(self) -> bool:
        """Read one frame in the logger."""
        data = self.reader.overheard(wait=True)
        if data is not None:
            self.received += len(data)
            self.audience.handle_frame(data)
        return data is not None

    def close(self) -> None:
        self.reader.context.destroy(linger=0)
        self.sender.context.destroy(linger=0)


@pytest.fixture
def group(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(bus_module, "QUEUED", PARCELS)
    folder = RunFolder(RUN)
    made = Group(str(tmp_path), str(tmp_path / "run.mcap"))
    yield made
    made.close()
    folder.close()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5], ids=["stopped", "slow", "half as fast"])
def test_what_a_slow_logger_does_not_receive_is_counted(group, tmp_path, share):
    for tick in range(STEPS):
        group.sender.keep(torque(tick))
        if tick % TICKS_OF_HEALTH == 0:
            group.sender.keep(frame(HEALTH, health(tick + 1)))
        group.sender.flush()
        if int(tick * share) != int((tick - 1) * share):
            group.read()
    before = group.received
    group.sender.final = [health(STEPS)]
    closing = threading.Thread(target=group.sender.close, args=(True,), daemon=True)
    closing.start()
    until = time.monotonic() + 60.0
    while "nodes" not in group.audience.ended and time.monotonic() < until:
        group.read()
    assert "nodes" in group.audience.ended
    assert group.received - before <= BOUND + AHEAD + KERNEL, "more waited for the logger than its bound"
    while closing.is_alive() and time.monotonic() < until:  # the leaving reader must poll its socket
        group.reader.overheard(wait=True)
    assert not closing.is_alive()

    log = group.audience.slots[0].node
    log.stop()
    recording = Recording(tmp_path / "run.mcap")
    counts = recording.counts["node"]
    assert counts["lost"] > 0 and counts["count"] + counts["lost"] == STEPS
    assert sum(1 for _ in recording.payloads()) == counts["count"]
    text = f"lacks messages that did not reach it in time: node {counts['lost']}"
    assert text in lacking(tmp_path / "run.mcap") and any(text in note for note in log.notes())
    shown = CliRunner().invoke(app, ["info", str(tmp_path / "run.mcap")])
    assert str(counts["lost"]) in shown.output


@pytest.mark.parametrize("first", [0, 400], ids=["", "short ones first"])
def test_long_messages_take_no_more_memory_than_short_ones(group, first):
    """The bound does not depend on what was sent before: a limit that was set by the first messages let ten times as
    much wait."""
    for number in range(first + 100):
        group.sender.keep(frame("node", b"x" * (100 if number < first else 20 * LONGEST)))
        group.sender.flush()
    waiting = 0
    while (data := group.reader._observed.poll(500)) and (data := group.reader._observed.recv()):
        waiting += len(data)
    assert 0.5 * BOUND < waiting <= BOUND + AHEAD + KERNEL


@pytest.mark.parametrize("seed", range(4))
def test_frames_of_changing_length_never_end_the_transfer(group, seed):
    """A limit that changed while frames were under way left the writer waiting for a report of the reader forever."""
    draw = random.Random(seed)

    def send(length):
        group.sender.keep(frame("node", b"x" * length))
        group.sender.flush()

    for _ in range(40):
        length = draw.choice([100, 300, 1000, 3000, 10_000])
        for _ in range(draw.randint(1, 40)):
            send(length)
            group.reader.overheard(wait=False)
        while group.reader.overheard(wait=True) is not None:
            pass
        until = time.monotonic() + 5.0
        send(length)
        while group.reader.overheard(wait=True) is None:
            assert time.monotonic() < until, "nothing that is sent arrives any more"
            send(length)


def test_short_blocks_that_were_sent_together_are_read_as_one(group):
    """At 5 kHz the logger took half a period to read the six blocks of eight messages that a parcel contains."""
    output = Output("node", Torque, external=False)
    output.observed = True
    for begin in range(0, 48, 8):
        memory, entries = bytearray(), []
        for tick in range(begin, begin + 8):
            payload = pack(Torque(torques=(1.0, 2.0, float(tick)), tick=tick, source="node"))
            memory += bytes(MARGIN) + payload
            entries.append((0, tick, 0, len(memory) - len(payload), len(memory)))
        group.sender.keep_block(Block(["node"], np.array(entries, ENTRY), np.frombuffer(memory, np.uint8)), [output])
    group.sender.flush()
    assert group.audience.handle_frame(group.reader.overheard(wait=True)) == 47
    assert group.audience.slots[0].last["node"] == 47 and group.reader.overheard(wait=False) is None


TWO = """
nodes:
  source: {use: nodes_for_runs.Source, in: {torque: sum}}
  spring: {use: nodes_for_runs.Spring, in: {pose: source}}
  drag:   {use: nodes_for_runs.Drag, in: {pose: source, force: spring}}
  spread: {use: nodes_for_runs.Spread, in: {force: spring, friction: drag}}
  sum:    {use: nodes_for_runs.Sum, in: {load: spread, friction: drag}}
  one:    {use: nodes_for_runs.Slow, in: all}
  log:    {use: nodes_for_runs.SlowLogger, in: all, pause: 0.002}
"""


def test_observers_in_groups_of_nodes_receive_all_messages_of_the_other_group(tmp_path):
    """Two groups that read each other; the logger is slower than the run, so its messages wait until the end."""
    place = tmp_path / "place.yaml"
    place.write_text("a: [source, spring, drag, one]\nb: [spread, sum, log]\n")
    launch = LaunchFile(graph=write_graph(tmp_path, TWO), duration=0.5, clock="real", place=place)
    outcome = execute(launch.but(record=tmp_path / "run.mcap"))
    assert outcome.result.ok, outcome.result.deaths
    steps = {node: health["steps"] for node, health in outcome.result.health.items()}
    observed = steps.pop("one"), steps.pop("log")
    assert Recording(tmp_path / "run.mcap").counts == {n: {"count": c, "lost": 0} for n, c in steps.items()}
    assert observed == (sum(steps.values()),) * 2
