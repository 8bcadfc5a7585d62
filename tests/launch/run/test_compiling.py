"""The first run on a machine says that it compiles, once, on a terminal or not; later ones say nothing."""

import numba
import pytest
from rich.console import Console

from palpate.launch.run.result import Result
from palpate.launch.run.screen import Screen
from palpate.launch.run.work.compiling import compiling


def test_each_kernel_that_is_compiled_is_counted_and_none_that_is_there_already():
    kernels = [numba.njit(lambda x, k=k: x + k) for k in range(3)]
    printed = []
    with compiling(printed.append):
        for kernel in (*kernels, *kernels):
            kernel(1.0)
    assert printed == [1, 2, 3]
    numba.njit(lambda x: x)(1.0)
    assert printed == [1, 2, 3]


@pytest.mark.parametrize("terminal", [False, True])
def test_the_first_run_says_that_it_compiles_once(terminal):
    console = Console(width=120, force_terminal=terminal)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        for kernels in (0, 1, 0, 2):
            screen._drawn = 0.0
            screen.show(Result(), "starting", {"tissue": "tissue"}, kernels)
    printed = capture.get()
    assert printed.count("compiling the kernels for this processor: once") == 1
    assert ("2 of about" in printed) is terminal  # next to the bar


def test_a_run_that_loads_its_kernels_says_nothing():
    console = Console(width=120)
    with console.capture() as capture, Screen(console, "kidney", 1000.0, 100, ["tissue"]) as screen:
        screen.show(Result(), "starting", {"tissue": "tissue"}, 0)
    assert capture.get() == ""
