"""Reports the compilation of kernels in the first run on a machine, and spreads it over two cores."""

import contextlib
import mmap
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from palpate.compiler.cores import usable_cores

KERNELS = "palpate.compiler.kernel"  # with the first of them
LONGEST = 1800.0  # [s] limit for the compilation of one function, also on a slow or loaded machine


@contextmanager
def compiler_watched(changed: Callable[[bool], None]) -> Iterator[None]:
    """Call `changed` with True when the compiler begins with a function or waits for another process that compiles it,
    and with False when it has ended. No effect in a process that has not imported kernels."""
    if KERNELS not in sys.modules:
        yield
        return
    from numba.core import event

    from palpate.compiler.target.dispatcher import COMPILING

    class Working(event.Listener):  # type: ignore[misc]
        depth, process = 0, os.getpid()  # a forked child also compiles, but must not report

        def on_start(self, event: Any) -> None:
            self.depth += 1
            if self.process == os.getpid():
                changed(True)

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.process == os.getpid():
                changed(self.depth > 0)

    listener = Working()
    with event.install_listener("numba:compile", listener), event.install_listener(COMPILING, listener):
        yield


@contextmanager
def compiling(report: Callable[[int], None], others: Sequence[Callable[[], object]] = ()) -> Iterator[None]:
    """Call `report` before each compilation of a kernel, with the number so far. Cached kernels do not count. No effect
    in a process that has not imported kernels.

    others  calls that also compile: a second process runs them from the first compilation on and fills the disk cache
    """
    if KERNELS not in sys.modules:
        yield
        return
    from numba.core import event

    class Compiled(event.Listener):  # type: ignore[misc]
        count = 0
        helper: int | None = None
        helped = mmap.mmap(-1, 1)  # number compiled by the second process

        def on_start(self, event: Any) -> None:
            if self.helper is None and others and hasattr(os, "fork") and len(usable_cores()) > 1:
                with warnings.catch_warnings():  # about threads: only the live view has one, the child does not use it
                    warnings.simplefilter("ignore", DeprecationWarning)
                    self.helper = os.fork()
                if not self.helper:
                    _call(others)
            self.count += 1
            if self.helper == 0:
                self.helped[0] = min(self.count, 255)
            else:
                report(self.count + self.helped[0])

        def on_end(self, event: Any) -> None:
            pass

    from palpate.registry import collection_suspended

    listener = Compiled()
    with event.install_listener("numba:compile", listener), collection_suspended():
        try:
            yield
        finally:
            if listener.helper:
                os.kill(listener.helper, signal.SIGKILL)
                os.waitpid(listener.helper, 0)


def _call(calls: Sequence[Callable[[], object]]) -> NoReturn:
    from palpate.launch.run.descendants import die_with_parent

    try:
        die_with_parent()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115
        for call in calls:
            with contextlib.suppress(Exception):  # the first process meets the same error and reports it
                call()
    finally:
        os._exit(0)
