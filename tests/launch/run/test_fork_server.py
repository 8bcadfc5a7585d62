"""The fork server of a launcher that has a real-time priority."""

import contextlib
import os
import time

import pytest

from palpate.launch.run.forkserver import ForkServer


@contextlib.contextmanager
def real_time():
    """Give this process a real-time priority, as `chrt` does."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(2))
    except PermissionError:
        pytest.skip("no permission for a real-time priority")
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def test_it_has_an_ordinary_priority():
    """Above the lowest real-time priority it once waited forever for the last thread of a dead worker on its core."""
    with real_time():
        server = ForkServer()
    try:
        until = time.monotonic() + 20.0
        while os.sched_getscheduler(server.process.pid) != os.SCHED_OTHER and time.monotonic() < until:
            time.sleep(0.01)
        assert os.sched_getscheduler(server.process.pid) == os.SCHED_OTHER
    finally:
        server.close()
