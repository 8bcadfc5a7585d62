"""Threads that run lanes in compiled code. None of them is left running when a call ends, however it ends."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

BLOCK = 0.02  # [s] target duration of a call of compiled code, because Ctrl-C waits for its end
FIRST = 8  # ticks of the first call

Work = Callable[[Callable[[], bool]], None]
"""What a thread does. It gets a function that returns whether to stop, and asks it after each call of compiled code."""


def adapt_block(block: int, took: float) -> int:
    """The number of ticks of the next call, after a call of `block` ticks that took this time [s]."""
    return max(1, block // 2) if took > BLOCK else block * 2 if took < 0.5 * BLOCK else block


class LaneThreads:
    """A pool of threads, started at the first call and again after a fork, an exception or `close`."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: ThreadPoolExecutor | None = None
        self._owner = 0  # process of the pool: a child after a fork has none of its threads

    def run(self, work: Sequence[Work], waiting: Callable[[], None] = lambda: None) -> None:
        """Do all of this work, and call `waiting` ten times a second meanwhile.

        The first exception of the work, and KeyboardInterrupt, are raised after all threads have stopped.
        """
        if self._pool is None or self._owner != os.getpid():
            self._pool, self._owner = ThreadPoolExecutor(self.count, "palpate lanes"), os.getpid()
        stop = threading.Event()
        try:
            futures = [self._pool.submit(each, stop.is_set) for each in work]
            while wait(futures, timeout=0.1, return_when=FIRST_EXCEPTION).not_done:
                waiting()
                if any(future.done() and future.exception() for future in futures):
                    break
            for future in futures:
                if future.done():
                    future.result()
        except BaseException:
            stop.set()
            self.close()
            raise

    def close(self) -> None:
        """Wait for the threads, at most for one call of compiled code each, through any further Ctrl-C."""
        pool, self._pool = self._pool, None
        while pool is not None and self._owner == os.getpid():
            try:
                pool.shutdown(cancel_futures=True)
                return
            except KeyboardInterrupt:
                continue
