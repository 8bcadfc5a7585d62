"""logger.LSL as the library of the Lab Streaming Layer receives it, on this machine alone."""

import contextlib
import os
import signal
import sys
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import graphs_for_runs
import numpy as np
import pytest
from typer.testing import CliRunner
from warm_fork_server import palpate

from palpate.cli.__main__ import app
from palpate.messages import Contact, Force, Surface, pack
from palpate.nodes.base import SettingError, Stream
from palpate.nodes.logger.lsl import LSL
from palpate.records.reader import Recording

SUPPORT = Path(__file__).parents[2] / "support"
CONTACT = Stream("contact", Contact, "contact", 1)
HAND = Stream("controller", Force, "controller", 2)
UP = (0.0, 0.0, 1.0)
GRAPH = f"rate: 500{graphs_for_runs.GRAPH.rstrip()}\n" + (
    "  lsl:    {use: logger.LSL, in: [spring, source], fields: [force, position], name: NAME}\n"
)


@pytest.fixture(scope="module")
def pylsl(tmp_path_factory):
    """The library, told to stay on this machine."""
    config = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    config.write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -2\n")
    os.environ["LSLAPICFG"] = str(config)
    yield pytest.importorskip("pylsl", reason="pylsl is not installed", exc_type=ImportError)
    del os.environ["LSLAPICFG"]


@pytest.fixture
def sender():
    """Starts an LSL node under a name of its own; its streams end with the test."""
    begun = []

    def start(fields: tuple[str, ...], *streams: Stream, rate: float = 1000.0) -> LSL:
        node = LSL(fields=fields, name=f"palpate-{uuid.uuid4().hex[:8]}")
        node.listen(streams, {"plan": {"rate": rate}})
        node.start()
        begun.append(node)
        return node

    yield start
    for node in begun:
        node.stop()


def receiver(pylsl, name: str):
    """An inlet that is connected. The name is a new one: the outlet is the test's."""
    (found,) = pylsl.resolve_byprop("name", name, timeout=60)
    inlet = pylsl.StreamInlet(found, recover=False)
    inlet.open_stream(timeout=60)
    return inlet


def received(inlet, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Samples (count,c) and their times [s]."""
    samples, times, until = [], [], time.monotonic() + 60
    while len(samples) < count and time.monotonic() < until:
        more, at = inlet.pull_chunk(timeout=0.5)
        samples += list(more)
        times += list(at)
    return np.array(samples), np.array(times)


@contextlib.contextmanager
def started(folder: Path, *words: object, interrupted: bool = False):
    """A command as from a shell, which ends well by itself, or by Ctrl-C."""
    paths = os.pathsep.join([str(SUPPORT), os.environ.get("PYTHONPATH", "")])
    told = folder / "told"
    with told.open("wb") as out:
        process = palpate(
            [str(word) for word in words], cwd=folder, env={**os.environ, "PYTHONPATH": paths}, stdout=out, stderr=out
        )
    try:
        yield
        if interrupted:
            process.send_signal(signal.SIGINT)
        assert process.wait(120) == (130 if interrupted else 0), told.read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def contact(tick: int, force: float) -> bytes:
    return pack(Contact((0.1, 0.2, 0.3), UP, force, 1e-3, 2e-3, 0.0, 0.0, tick=tick, time=tick * 1_000_000))


def test_a_stream_has_the_labels_units_and_rate_of_its_fields(pylsl, sender):
    node = sender(("force", "foot"), CONTACT, HAND)
    told = receiver(pylsl, f"{node.name}.contact").info(timeout=60)
    channels, found = told.desc().child("channels").child("channel"), []
    for _ in range(told.channel_count()):
        found.append((channels.child_value("label"), channels.child_value("unit")))
        channels = channels.next_sibling("channel")
    assert found == [("foot[0]", "m"), ("foot[1]", "m"), ("foot[2]", "m"), ("force", "N")]
    assert (told.type(), told.nominal_srate()) == ("Contact", 1000.0)
    hand = receiver(pylsl, f"{node.name}.controller").info(timeout=60)
    assert (hand.type(), hand.nominal_srate(), hand.channel_count()) == ("Force", 500.0, 3)


def test_samples_have_the_values_and_the_graphs_times_on_the_clock_of_lsl(pylsl, sender):
    node = sender(("force", "indentation"), CONTACT)
    inlet = receiver(pylsl, f"{node.name}.contact")
    origin = time.monotonic_ns() - 5_000_000_000
    node.begun(origin)
    ticks = [0, 1, 2, 5, 6]
    for tick in ticks:
        node.observe("contact", tick, contact(tick, force=0.1 * tick))
    samples, times = received(inlet, len(ticks))
    assert samples == pytest.approx(np.array([[0.1 * tick, 2e-3] for tick in ticks]), abs=0)
    assert np.diff(times) == pytest.approx(np.diff(ticks) * 1e-3, abs=1e-9)
    assert times[0] == pytest.approx(pylsl.local_clock() - (time.monotonic_ns() - origin) * 1e-9, abs=1e-3)


def test_the_last_samples_arrive_before_the_stream_ends(pylsl, sender):
    node = sender(("force",), CONTACT)
    inlet = receiver(pylsl, f"{node.name}.contact")
    listening = ThreadPoolExecutor(1).submit(received, inlet, 5000)
    for tick in range(5000):
        node.observe("contact", tick, contact(tick, force=float(tick)))
    node.stop()
    assert listening.result(60)[0][:, 0].tolist() == list(range(5000))


def test_a_flag_is_a_number(pylsl, sender):
    from palpate.messages import Friction

    node = sender(("stick",), Stream("friction", Friction, "friction", 1))
    inlet = receiver(pylsl, f"{node.name}.friction")
    for tick, stick in enumerate((True, False)):
        node.observe("friction", tick, pack(Friction((0, 0, 0), (0, 0, 0), stick, tick=tick, time=tick)))
    assert received(inlet, 2)[0].tolist() == [[1.0], [0.0]]


@pytest.mark.parametrize(
    ("fields", "stream", "words"),
    [
        (("forse",), CONTACT, "stream 'contact' has none of forse; it can send foot, normal, force, compression"),
        (("force", "depth"), CONTACT, "none of the streams contact has a field 'depth'"),
        (("state",), HAND, "controller.state is a text or an array of changing length"),
        (("displacement",), Stream("tissue", Surface, "tissue", 1), "tissue.displacement is a text or an array"),
    ],
)
def test_fields_that_cannot_be_sent_are_told(pylsl, sender, fields, stream, words):
    with pytest.raises(SettingError, match=words):
        sender(fields, stream)


def test_a_missing_library_is_told_with_what_to_install(sender, monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(SettingError, match=r'pylsl is not installed; pip install "palpate\[lsl\]"'):
        sender(("force",), CONTACT)


def test_a_graph_names_its_fields():
    with pytest.raises(SettingError, match=r"'fields' \[1\]: missing"):
        LSL()


def test_a_run_sends_what_it_records_at_the_times_of_its_ticks(pylsl, write, tmp_path):
    name = f"palpate-{uuid.uuid4().hex[:8]}"
    graph, file = write("loop.yaml", GRAPH.replace("NAME", name)), tmp_path / "a.mcap"
    before = pylsl.local_clock()
    with started(tmp_path, "run", graph, "--clock", "real", "--record", file, interrupted=True):
        inlet = receiver(pylsl, f"{name}.spring")
        samples, times = received(inlet, 500)
        after = pylsl.local_clock()
    recorded = Recording(file).columns("spring")
    begin = int(np.flatnonzero(recorded["force"][:, 0] == samples[0, 0])[0])
    told = times - times[0] + recorded["time"][begin]
    rows = np.clip(np.searchsorted(recorded["time"], told - 1e-6), 0, len(recorded["time"]) - 1)
    there = np.abs(recorded["time"][rows] - told) < 1e-6  # a busy machine may have kept some from the recording
    assert there.sum() > 0.9 * len(samples) >= 450
    assert np.array_equal(samples[there], recorded["force"][rows[there]])
    assert before < times[0] - recorded["time"][begin] < times[-1] < after


def test_a_replay_sends_the_recorded_numbers_again(pylsl, write, tmp_path):
    name = f"palpate-{uuid.uuid4().hex[:8]}"
    graph, file = write("loop.yaml", GRAPH.replace("NAME", name)), tmp_path / "a.mcap"
    with started(tmp_path, "run", graph, "--fused", "--duration", 6, "--record", file):
        pass
    recorded = Recording(file).columns("spring")
    with started(tmp_path, "replay", file, "--speed", 1, "--trust", "nodes_for_runs"):
        inlet = receiver(pylsl, f"{name}.spring")
        samples, times = received(inlet, 200)
    begin = int(np.flatnonzero(recorded["force"][:, 0] == samples[0, 0])[0])
    own = slice(begin, begin + len(samples))
    assert np.array_equal(samples, recorded["force"][own])
    assert times - times[0] == pytest.approx(recorded["time"][own] - recorded["time"][begin], abs=1e-6)


def test_a_graph_with_it_is_checked_without_the_library(write, monkeypatch):
    monkeypatch.syspath_prepend(SUPPORT)
    monkeypatch.setitem(sys.modules, "pylsl", None)
    result = CliRunner().invoke(app, ["check", str(write("loop.yaml", GRAPH))], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
