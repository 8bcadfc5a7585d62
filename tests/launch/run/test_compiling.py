"""The first run on a machine reports the compilation once, on a terminal or not; later runs report nothing."""

import numba
import pytest
from rich.console import Console

from palpate.launch.run.result import Result
from palpate.launch.run.screen import Screen
from palpate.launch.run.work.compiling import compiling


def test_compiled_kernels_are_counted_and_cached_ones_are_not():
    kernels = [numba.njit(lambda x, k=k: x + k) for k in range(3)]
    printed = []
    with compiling(printed.append):
        for kernel in (*kernels, *kernels):
            kernel(1.0)
    assert printed == [1, 2, 3]
    numba.njit(lambda x: x)(1.0)
    assert printed == [1, 2, 3]


@pytest.mark.parametrize("terminal", [False, True])
def test_the_first_run_reports_the_compilation_once(terminal):
    console = Console(width=120, force_terminal=terminal)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        for kernels in (0, 1, 0, 2):
            screen._drawn = 0.0
            screen.show(Result(), "starting", {"tissue": "tissue"}, kernels)
    printed = capture.get()
    assert printed.count("compiling the kernels for this processor: once") == 1
    assert ("2 of about" in printed) is terminal  # text of the bar


def test_a_run_with_cached_kernels_reports_nothing():
    console = Console(width=120)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        screen.show(Result(), "starting", {"tissue": "tissue"}, 0)
    assert capture.get() == ""
