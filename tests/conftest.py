"""What several tests of the launcher share: graphs written for one test, of the small nodes in graph_nodes.py."""

# ruff: noqa: E402
from palpate.compiler.arithmetic import pin

pin()  # before anything below imports numpy

import functools
import gc
import os
import signal
import textwrap

import hypothesis
import pytest
import typer.testing
from expected_notes import only_expected
from slow_tests import SlowTests
from whole_touch import WHOLE

from palpate.compiler import kernel_cache
from palpate.launch.run.wire.addresses import has_unix_sockets

gc.disable()  # until all tests are collected

# Tests that a shell starts in the background may inherit these signals as ignored: Ctrl-C would reach no process.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

if has_unix_sockets():
    import warm_fork_server

    warm_fork_server.use()
# A test with a separate XDG_CACHE_HOME and the processes that it starts would compile all kernels again.
os.environ.setdefault("NUMBA_CACHE_DIR", str(kernel_cache.folder().parent))
os.environ["PALPATE_TESTS"] = str(os.getpid())  # by which a node knows this process from those below it

# Commands are called by the hundred, and typer builds the tree of all of them for each.
typer.testing._get_command = functools.cache(typer.testing._get_command)

# Time is no property of what is tested: a kernel compiles at its first call, and a machine may be busy.
hypothesis.settings.register_profile("palpate", deadline=None)
hypothesis.settings.load_profile("palpate")


def pytest_addoption(parser):
    parser.addoption("--all", dest="all_tests", action="store_true", help="also the tests of tests/slow.txt")
    parser.addoption("--quick", action="store_true", help="without the tests of tests/slow.txt, of named files as well")
    parser.addoption("--measure", action="store_true", help="write tests/slow.txt from the processor times of this run")


def pytest_configure(config):
    config.pluginmanager.register(SlowTests(config), "slow-tests")


def pytest_collection_finish():
    """What was imported and collected stays to the end: the garbage collector need not go through it again."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    with only_expected(item):
        return (yield)


@pytest.fixture(scope="session")
def short_kidney(tmp_path_factory):
    """The recording of a short touch of the kidney, for all tests that only read one."""
    from short_touch import short_touch

    return short_touch(tmp_path_factory.mktemp("touch"), "kidney").path


@pytest.fixture
def write(tmp_path):
    """Writes a file below the test's folder and gives its path."""

    def put(name, text):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text), encoding="utf-8")
        return file

    return put


@pytest.fixture
def whole(write):
    """A whole touch: device, finger, contact, friction, tissue, controller, log."""
    return write("whole.yaml", WHOLE)


@pytest.fixture
def chain():
    """Makes a graph that runs by the rules of the real clock in virtual time."""
    from palpate.studies.faults.chain import Chain

    return Chain
