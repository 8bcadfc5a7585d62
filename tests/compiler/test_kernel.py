"""Kernels are compiled once: for Python only if Python calls them, and by one process at a time."""

import gc
import os
import signal
import subprocess
import sys
import time

import numba
import numpy as np
import pytest
from numba.core.compiler import CompileResult

from palpate.compiler.kernel import kernel
from palpate.launch.run.work.compiling import compiling

SOURCE = """
import numpy as np
from palpate.compiler.kernel import ieee_kernel, kernel


@kernel
def inner(x):
    return np.linalg.norm(x) ** 2

@kernel
def outer(x):
    return inner(x) + 1.0

@ieee_kernel
def other(x):
    return inner(x) / 0.0

@kernel
def times(x, k, up):
    return x * k if up else x / k

@kernel
def twice_and_half(x):
    return times(x, 2, True) + times(x, 4, up=True) + times(x, 2, False)
"""
COMPILED = """
import numba.core.event, numpy as np, kernels
print("ready", flush=True)
input()
with numba.core.event.install_recorder("numba:compile") as recorded:
    kernels.outer(np.ones(3))
names = [event.data["dispatcher"].py_func.__name__ for _, event in recorded.buffer if event.is_start]
print(*(name for name in names if hasattr(kernels, name)))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "kernels.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    yield tmp_path
    sys.modules.pop("kernels", None)


def test_a_kernel_that_only_kernels_call_has_no_wrapper_for_python(folder):
    import kernels

    assert kernels.outer(np.ones(3)) == pytest.approx(4.0)
    assert not kernels.inner.signatures and len(kernels.inner.bare.signatures) == 1
    assert kernels.inner(np.ones(3)) == kernels.outer(np.ones(3)) - 1.0
    assert len(kernels.inner.signatures) == 1


def test_constant_arguments_do_not_compile_separate_code(folder):
    import kernels

    assert kernels.twice_and_half(3.0) == 6.0 + 12.0 + 1.5
    assert len(kernels.times.bare.signatures) == 1
    assert gc.isenabled()


def test_ctrl_c_waits_until_a_kernel_is_loaded(folder, monkeypatch):
    import kernels

    assert kernels.outer(np.ones(3)) == pytest.approx(4.0)
    again, loaded, rebuild = kernel(kernels.outer.py_func), [], CompileResult._rebuild

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        loaded.append(rebuild(*given))
        return loaded[-1]

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(CompileResult, "_rebuild", interrupted)
        again(np.ones(3))
    assert loaded and again(np.ones(3)) == pytest.approx(4.0)


def test_two_processes_that_need_the_same_kernels_compile_them_once(folder):
    """Both start at the same time, and one of them waits."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    both = [
        subprocess.Popen([sys.executable, "-c", COMPILED], env=environment, stdin=-1, stdout=-1, text=True)
        for _ in range(2)
    ]
    for process in both:
        assert process.stdout.readline() == "ready\n"
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    assert sorted(process.communicate(timeout=60)[0].split() for process in both) == [[], ["outer", "inner"]]


def test_a_second_process_compiles_later_kernels_in_parallel(folder, monkeypatch):
    import kernels

    fork, forked, printed = os.fork, [], []
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(os, "fork", lambda: forked.append(fork()) or forked[-1])
    with compiling(printed.append, [lambda: 1 / 0, lambda: kernels.other(np.ones(3))]):
        kernels.outer(np.ones(3))
        while not list(
            (folder / "cache").rglob("*other-*.nbc")
        ):  # compiled by the second process; this one does not call it
            time.sleep(0.01)
        assert kernels.other(np.ones(3)) == np.inf
        kernels.inner(np.ones(3))
    assert sum(kernels.other.stats.cache_hits.values()) == 1
    assert printed[-1] > len(printed)  # includes those of the second process
    with pytest.raises(ChildProcessError):  # the child has ended
        os.waitpid(*forked, os.WNOHANG)
