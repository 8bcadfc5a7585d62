"""SIGINT, SIGTERM and SIGHUP at any stage of a command: the exit code is 128 plus the number of the signal."""

import contextlib
import os
import random
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest
import typer
from graphs_for_runs import write_graph
from nodes_for_runs import Drag
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.cli.commands.recordings import echo
from palpate.cli.terminal import browser, group
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.views import page, pictures

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
SOURCES = str(Path(palpate.__file__).parent)
DRAWS = 4  # random stages of each command
RUN = ("run", "{graph}", "--fused", "--duration", "0.05", "--record", "new.mcap")
COMMANDS = {
    "run": RUN,
    "run in processes": tuple(word for word in RUN if word != "--fused"),
    "check": ("check", "{graph}"),
    "plan": ("plan", "{graph}"),
    "info": ("info", "{file}"),
    "export": ("export", "{file}", "--to", "csv", "-o", "out"),
    "replay": ("replay", "{file}", "--check"),
    "compare": ("compare", "{file}", "--set", "drag.every=2"),
    "list": ("list", "nodes"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A graph and a recording of it."""
    folder = tmp_path_factory.mktemp("stages")
    launch = LaunchFile(graph=write_graph(folder), duration=0.1, record=folder / "run.mcap", place="fused")
    assert execute(launch).ok
    return folder


def invoke(folder: Path, words: tuple[str, ...]) -> int:
    graph = next(folder.glob("*.yaml"))
    return CliRunner().invoke(app, [w.format(graph=graph, file=folder / "run.mcap") for w in words]).exit_code


def forked(folder: Path, act: Callable[[], int]) -> int:
    """The result of a call in a fork of this process, up to 255: an interrupted import would spoil other tests."""
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        code = 255
        try:
            code = act()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def with_signal_at(folder: Path, words: tuple[str, ...], number: int, at: int) -> tuple[int, int]:
    """Exit code of a command that receives a signal at its `at`-th call of a function of palpate, and the number of
    these calls; at 0: no signal."""
    reading, writing = os.pipe()
    calls, enter = 0, group._interruptible

    def count(frame: FrameType, event: str, _: object) -> None:
        nonlocal calls
        if event == "call" and frame.f_code.co_filename.startswith(SOURCES):
            calls += 1
            if calls == at:
                sys.setprofile(None)
                signal.raise_signal(number)

    @contextlib.contextmanager
    def counted(numbers: list[int]) -> Iterator[None]:
        with enter(numbers):
            sys.setprofile(count)
            try:
                yield
            finally:
                sys.setprofile(None)

    def act() -> int:
        group._interruptible = counted  # type: ignore[assignment]
        code = invoke(folder, words)
        os.write(writing, b"%d" % calls)
        return code

    code = forked(folder, act)
    os.close(writing)
    with os.fdopen(reading) as printed:
        return code, int(printed.read() or 0)


@pytest.mark.parametrize(
    "name", [n if n in ("run", "check", "replay") else pytest.param(n, marks=pytest.mark.long) for n in COMMANDS]
)
def test_a_signal_at_any_stage_of_a_command_gives_its_exit_code(folder, name):
    rng = random.Random(name)
    ended, calls = with_signal_at(folder, COMMANDS[name], signal.SIGINT, 0)
    assert ended == 0 and calls > 100
    for number, code in CODES.items():
        for _ in range(DRAWS):
            at = rng.randint(1, int(0.95 * calls))  # the number of calls varies a little
            assert with_signal_at(folder, COMMANDS[name], number, at)[0] == code, (name, number, at)


@pytest.mark.parametrize(("number", "code"), CODES.items())
def test_a_signal_while_pictures_are_drawn_gives_its_exit_code(folder, monkeypatch, number, code):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(pictures, "draw_pictures", lambda *_: signal.raise_signal(number))
    assert invoke(folder, (*RUN, "--out", "pictures")) == code


@pytest.mark.parametrize(("number", "code"), {**CODES, signal.SIGINT: 0}.items())
def test_a_signal_to_a_page_or_a_repeated_replay_gives_its_exit_code(folder, monkeypatch, number, code):
    """Ctrl-C is their normal end."""

    class Page:
        address, deserted = "", False

        def close(self) -> None:
            pass

    def serve(*_: object) -> Page:
        threading.Timer(0.05, os.kill, (os.getpid(), number)).start()
        return Page()

    monkeypatch.setattr(page, "serve", serve)
    program = typer.Typer(cls=group.Verbs)
    program.command()(lambda: None)

    @program.command()
    def look() -> None:
        browser.show(None, "see", 0, "127.0.0.1", no_open=True)  # type: ignore[arg-type]

    assert CliRunner().invoke(program, ["look"]).exit_code == code
    monkeypatch.setattr(Drag, "start", lambda _: signal.raise_signal(number))
    assert invoke(folder, ("replay", "{file}", "--loop")) == code


@pytest.mark.parametrize(("number", "code"), {**CODES, signal.SIGINT: 0}.items())
def test_a_signal_while_messages_are_printed_gives_its_exit_code(folder, monkeypatch, number, code):
    monkeypatch.setattr(echo, "line", lambda _: signal.raise_signal(number))
    assert invoke(folder, ("echo", "{file}", "source")) == code
