"""Measures the bodies of a page in another process, so that neither the page nor the run waits."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

Figures = dict[str, Any]
NICE = 10  # niceness of the process, so that the run has priority


class Measuring:
    """One measurement.

    measure  returns the figures; can be pickled
    done     called from a thread with the figures, or with `why` if the process died
    """

    def __init__(self, measure: Callable[[], Figures], done: Callable[[Figures], None]) -> None:
        own, other = multiprocessing.get_context("spawn").Pipe(duplex=False)
        self._process = multiprocessing.get_context("spawn").Process(target=_send, args=(other, measure), daemon=True)
        self._process.start()
        other.close()
        self._done, self._pipe = done, own
        self._thread = threading.Thread(target=self._wait, name="measuring", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._thread.join()

    def _wait(self) -> None:
        try:
            figures = self._pipe.recv()
        except EOFError:
            figures = {"why": "the measurement ended early"}
        self._process.join()
        self._done(figures)


def _send(pipe: Connection, measure: Callable[[], Figures]) -> None:
    if hasattr(os, "nice"):
        os.nice(NICE)
    pipe.send(measure())
    pipe.close()
