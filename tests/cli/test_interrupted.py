"""After Ctrl-C, SIGTERM or a closed terminal a command ends at once with one line and leaves no partial results."""

import fcntl
import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import termios
import time
import weakref
from pathlib import Path

import pytest
import typer
from graphs_for_runs import write_graph
from nodes_for_runs import Drag
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.cli.terminal.group import Verbs
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.records.export import export
from palpate.records.reader import Recording
from palpate.studies.search import record_touch


def ctrl_c(*_: object) -> None:
    signal.raise_signal(signal.SIGINT)


def recorded(folder: Path, only: str | None = None) -> Path:
    file = folder / "run.mcap"
    assert execute(LaunchFile(graph=write_graph(folder), duration=0.3, record=file, place="fused", only=only)).ok
    return file


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("touch"))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_ends_a_command_with_one_line_and_its_exit_code(number, code):
    program, left = typer.Typer(cls=Verbs), []

    @program.command()
    def work() -> None:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt as error:
            error.add_note("3 of 4 points are stored")
            raise
        finally:
            left.append("cleaned up")

    program.command()(lambda: None)
    before = signal.getsignal(number), sys.unraisablehook
    done = CliRunner().invoke(program, ["work"])
    assert (done.exit_code, done.stderr, left) == (code, "stopped; 3 of 4 points are stored\n", ["cleaned up"])
    assert (signal.getsignal(number), sys.unraisablehook) == before


def test_a_closed_terminal_ends_a_run_gracefully(tmp_path):
    """Printing to a closed terminal raises OSError, which must not end the run before the recording is complete."""
    file, (master, slave) = tmp_path / "run.mcap", pty.openpty()
    words = ["run", str(write_graph(tmp_path)), "--clock", "real", "--record", str(file)]
    support = str(Path(__file__).parents[1] / "support")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([support, os.environ.get("PYTHONPATH", "")])}
    with subprocess.Popen(
        [sys.executable, "-m", "palpate.cli", *words],
        stdin=slave, stdout=slave, stderr=slave, start_new_session=True, env=environment,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as running:  # fmt: skip
        os.close(slave)
        until = time.monotonic() + 60.0
        while not (file.exists() and file.stat().st_size > 12_000) and time.monotonic() < until:
            if select.select([master], [], [], 0.1)[0]:
                os.read(master, 1 << 16)
        os.close(master)
        assert running.wait(60.0) == 128 + signal.SIGHUP
    assert Recording(file).complete


def test_ctrl_c_in_a_callback_that_ignores_exceptions_ends_the_command():
    program, completed = typer.Typer(cls=Verbs), []

    @program.command()
    def work() -> None:
        watcher = weakref.ref(type("Short", (), {})(), ctrl_c)
        time.sleep(60.0)
        completed.append(watcher)

    program.command()(lambda: None)
    assert CliRunner().invoke(program, ["work"]).exit_code == 130
    assert not completed


@pytest.mark.parametrize(
    "words", [["replay"], ["replay", "--check"], ["compare", "--set", "drag.every=2"]], ids=" ".join
)
def test_ctrl_c_while_a_node_recomputes_a_touch_is_not_an_error_of_the_node(file, words, monkeypatch):
    monkeypatch.setattr(Drag, "start", ctrl_c)
    done = CliRunner().invoke(app, [*words, str(file)])
    assert (done.exit_code, done.stderr.strip()) == (130, "stopped")


def test_sigterm_to_a_background_command_is_not_an_error_of_a_node(file, monkeypatch):
    """SIGINT is ignored in background commands of scripts."""
    monkeypatch.setattr(Drag, "start", lambda *_: signal.raise_signal(signal.SIGTERM))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        done = CliRunner().invoke(app, ["replay", str(file)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert (done.exit_code, done.stderr.strip()) == (143, "stopped")


def test_an_interrupted_recomputation_leaves_no_file_and_is_repeated(tmp_path, monkeypatch):
    file = recorded(tmp_path, "sources")
    before, recording = set(tmp_path.iterdir()), Recording(file)
    with monkeypatch.context() as patch:
        patch.setattr(Drag, "start", ctrl_c)
        with pytest.raises(KeyboardInterrupt):
            recording.file()
        assert CliRunner().invoke(app, ["export", str(file), "--to", "mcap", "--full"]).exit_code == 130
    assert set(tmp_path.iterdir()) == before
    assert len(list(recording.messages("sum"))) == 300


def test_ctrl_c_ends_a_repeated_replay(file, monkeypatch):
    monkeypatch.setattr(Drag, "start", ctrl_c)
    assert CliRunner().invoke(app, ["replay", str(file), "--loop"]).exit_code == 0


def test_a_run_raises_keyboard_interrupt_and_the_next_run_works(tmp_path, monkeypatch):
    launch = LaunchFile(graph=write_graph(tmp_path), duration=0.1)
    for call in (lambda to: palpate.run(launch.graph, record=to, duration=0.1), lambda to: record_touch(launch, to)):
        file = tmp_path / "out" / "run.mcap"
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(Drag, "start", ctrl_c)
            call(file)
        assert not file.parent.exists()
        call(file)
        assert Recording(file).complete
        shutil.rmtree(file.parent)


@pytest.mark.parametrize("to", ["csv", "parquet", "foxglove"])
def test_an_interrupted_export_leaves_no_file(file, to, tmp_path, monkeypatch):
    decode = Recording.decode

    def until_a_file_is_begun(*given):
        if any(path.is_file() for path in tmp_path.rglob("*")):
            ctrl_c()
        return decode(*given)

    monkeypatch.setattr(Recording, "decode", until_a_file_is_begun)
    with pytest.raises(KeyboardInterrupt):
        export(Recording(file), to, tmp_path / "out")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
