"""Processes in virtual time, in one real process.

Each is a thread, and exactly one thread runs at any time. A call that waits hands control to the next event, so product
code runs unmodified and a seed repeats a run exactly. Only waiting and `compute` take virtual time.
"""

from __future__ import annotations

import random
import threading
from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import NoReturn

from palpate.studies.faults.launcher.process import Process

MS, SECOND = 1_000_000, 1_000_000_000  # [ns]
EVENTS = 50
SPIN = 100  # calls of a process without progress of time, which then take 5 ms
KILLED = -9  # exit code of a process that SIGKILL has ended, which not every system has


class KilledError(BaseException):
    """The process has ended: each further call of it raises this again."""


class World:
    """Time, processes and events.

    seed   of all delays
    limit  [ns] at which the simulation ends
    slow   fraction of the delays that are long, as on a busy machine
    """

    def __init__(self, seed: str, limit: int, slow: float = 0.002) -> None:
        self.seed, self.limit, self.slow = seed, limit, slow
        self.time = SECOND
        self.processes: list[Process] = []
        self.current: Process | None = None
        self.log: deque[str] = deque(maxlen=EVENTS)
        self.finished: Callable[[], bool] = lambda: False
        self.crash: BaseException | None = None
        self._events: list[tuple[int, int, Callable[[], Process | None]]] = []
        self._count = 0
        self._main = threading.Semaphore(0)
        self._closing = False

    def random_of(self, name: str) -> random.Random:
        """Random numbers of one process or connection, so that a fault that is left out changes no others."""
        return random.Random(f"{self.seed} {name}")

    def new_pid(self) -> int:
        return 1000 + len(self.processes)

    def note(self, text: str) -> None:
        self.log.append(f"{(self.time - SECOND) * 1e-9:.6f} s  {text}")

    def now(self) -> int:
        """What the clock of the running process shows [ns]."""
        return self.time if self.current is None else self.current.clock(self.time)

    def sleep_until(self, deadline: int) -> int:
        """As `engine.clock.sleep_until`."""
        process = self.check()
        if deadline > self.now():
            self.wait(process.time_at(deadline))
        return self.now() - deadline

    # -- events ----------------------------------------------------------------------------------------------------

    def at(self, moment: int, call: Callable[[], Process | None]) -> None:
        """Call this at a time [ns]; a process that it returns runs then."""
        self._count += 1
        heappush(self._events, (max(moment, self.time), self._count, call))

    def after(self, delay: int, call: Callable[[], object]) -> None:
        """Call this after a delay [ns]."""

        def run() -> None:
            call()

        self.at(self.time + delay, run)

    def delay(self, random_: random.Random) -> int:
        """Delay [ns] of a message or a wake-up: mostly microseconds."""
        if random_.random() < self.slow:
            return int(random_.random() ** 2 * 40 * MS)
        return random_.randint(4_000, 60_000)

    # -- calls of the running process ------------------------------------------------------------------------------

    def check(self) -> Process:
        """The process that runs. KilledError: it has ended."""
        process = self.current
        assert process is not None
        if process.killed:
            raise KilledError
        if process.since != self.time:
            process.since, process.calls = self.time, 0
        process.calls += 1
        if process.calls > SPIN:  # it computes
            process.calls = 0
            self.compute(5 * MS)
        if process.interrupted:
            process.interrupted = False
            raise KeyboardInterrupt
        return process

    def wait(self, until: int | None, ready: Callable[[], bool] | None = None) -> None:
        """Wait until a time [ns] or until `ready`, which is asked after each `poke`."""
        process = self.check()
        if ready is not None and ready():
            return
        process.token += 1
        process.ready, process.until, process.blocked = ready, until, True
        if until is not None:
            token = process.token
            self.at(until, lambda: self._resume(process, token))
        self._dispatch(process)
        process.blocked, process.ready = False, None
        self.check()

    def compute(self, duration: int) -> None:
        """Use a processor for this time [ns]."""
        process = self.check()
        process.begun = self.time
        try:
            self.wait(self.time + duration)
        finally:
            if process.begun is not None:
                process.used += self.time - process.begun
            process.begun = None

    def exit(self, status: int) -> NoReturn:
        """End the running process, as `os._exit` or a signal does."""
        process = self.check()
        process.killed, process.status = True, status
        raise KilledError

    # -- processes -------------------------------------------------------------------------------------------------

    def start(self, process: Process, delay: int = 0) -> None:
        self.processes.append(process)
        token = process.token
        self.at(self.time + delay, lambda: self._resume(process, token))

    def poke(self, process: Process) -> None:
        """What the process waits for may have happened."""
        if process.blocked and process.ready is not None and process.scheduled != process.token and process.ready():
            process.scheduled = token = process.token
            self.at(self.time + self.delay(process.random), lambda: self._resume(process, token))

    def kill(self, process: Process, status: int = KILLED) -> None:
        """End a process that waits, as a signal does."""
        if process.alive and not process.killed:
            process.killed, process.status, process.stopped = True, status, False
            self.at(self.time, lambda: process if process.alive else None)

    def stop(self, process: Process) -> None:
        """SIGSTOP."""
        if not process.stopped:
            process.stopped, process.halted = True, self.time
            if process.begun is not None:
                process.used += self.time - process.begun
                process.token += 1  # its computation takes longer
                process.begun, process.left = None, (process.until or self.time) - self.time

    def resume(self, process: Process) -> None:
        """SIGCONT."""
        if not process.stopped:
            return
        process.stopped, token = False, process.token
        if process.left is not None:
            process.begun, process.until, process.left = self.time, self.time + process.left, None
            self.at(process.until, lambda: self._resume(process, token))
        elif process.due:
            process.due = False
            self.at(self.time + self.delay(process.random), lambda: self._resume(process, token))
        held, process.held = process.held, []
        for call in (*process.on_continue, *held):
            call()

    def interrupt(self, process: Process) -> None:
        """Ctrl-C in the terminal of a process without a handler."""
        if process.alive and not process.killed:
            process.interrupted = True
            token = process.token
            self.at(self.time, lambda: self._resume(process, token))

    def _resume(self, process: Process, token: int) -> Process | None:
        if not process.alive or token != process.token or not process.blocked:
            return None
        if process.stopped:
            process.due = True
            return None
        return process

    # -- the baton -------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Run until `finished`, until nothing happens any more, or until `limit`. Then all processes are removed."""
        self._dispatch(None)
        self._closing = True
        for process in self.processes:
            if process.alive and process.thread is not None:
                process.killed, self.current = True, process
                process.lock.release()
                process.thread.join()
        if self.crash is not None:
            raise self.crash

    def _dispatch(self, here: Process | None) -> None:
        """Handle events until a process runs. `here`: the one that waits; None: the caller of `run`."""
        if self._closing:
            raise KilledError
        following = self._next()
        if following is here:
            return
        if following is None:
            self._main.release()
        else:
            self._hand_to(following)
        (self._main if here is None else here.lock).acquire()

    def _next(self) -> Process | None:
        try:
            while self._events and self.crash is None:
                moment, _, call = heappop(self._events)
                if moment > self.limit or self.finished():
                    break
                self.time = moment
                process = call()
                if process is not None:
                    self.current = process
                    return process
        except BaseException as error:
            self.crash = error
        return None

    def _hand_to(self, process: Process) -> None:
        if process.thread is None:
            process.thread = threading.Thread(target=self._live, args=(process,), daemon=True, name=process.name)
            process.thread.start()
        else:
            process.lock.release()

    def _live(self, process: Process) -> None:
        process.blocked = False
        status = None
        try:
            if not process.killed:
                status = process.main()
        except KilledError:
            pass
        except BaseException as error:
            process.error, status = error, 1
        if self._closing:
            return
        if process.status is None:
            process.status = status
        process.ended, process.begun, process.killed = self.time, None, True
        self.note(f"{process.name} ends, status {process.status}")
        for call in process.on_end:
            call()
        following = self._next()
        if following is None:
            self._main.release()
        else:
            self._hand_to(following)
