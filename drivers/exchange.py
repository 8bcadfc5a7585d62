"""The thread that communicates with a device: newest command out, newest sample in. The force loop never waits for it.

It asks the guard before every command, keeps the device talking (some fall silent without traffic), looks for a device
that is gone when asked to, and leaves no force behind when it stops.
"""

import contextlib
import threading
import time
from typing import ClassVar, Protocol

from palpate.drivers.connected import LEAST
from palpate.drivers.errors import DeviceError
from palpate.drivers.guard import DeviceSample, Guard, ahead
from palpate.drivers.limits import Limits

RETRY = 0.5  # [s] between two looks for a device that is gone
FAREWELL = 3  # [1] zero commands before the device is closed
STOP, GLANCES = 2.0, 20  # [s] for the thread's end, in so many glances
RATED = 1.0  # [s] over which the rate of answers is taken
PAUSE = 0.1  # [s] a longer time without an answer is an outage, which says nothing of the rate


class Driver(Protocol):
    """One device, spoken to directly. All its methods are called from one thread at a time."""

    name: ClassVar[str]
    limits: Limits
    size: int
    """Numbers of a command."""

    def open(self) -> None:
        """Find the device and make it ready. DeviceError: why not, and what to do."""

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        """Send a command and take one answer; None when none came within a few periods.

        DeviceError: the device is gone.
        """

    def close(self) -> None:
        """Give the device back. It may be gone already."""


class Exchange:
    """A driver in a thread of its own.

    driver     the device; `open` is called by `start`, in the caller's thread
    guard      what its commands are held to
    reconnect  whether a device that is gone is waited for; otherwise `sample` raises what happened
    """

    def __init__(self, driver: Driver, guard: Guard, *, reconnect: bool = False) -> None:
        self.driver, self.guard, self.reconnect = driver, guard, reconnect
        self._command: tuple[tuple[float, ...], int] = ((0.0,) * driver.size, 0)
        self._newest: tuple[DeviceSample | None, tuple[tuple[float, ...], tuple[float, ...]]] = None, ((), ())
        self._fault: DeviceError | None = None
        self.lost: DeviceError | None = None  # what happened to a device that is waited for
        self._notes: list[str] = []
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.cycles = self.answers = 0
        self.rate = 0.0  # [Hz] of the device's answers over the last second in which it answered

    def start(self) -> None:
        """Open the device and begin to talk. DeviceError: it cannot be opened."""
        self.driver.open()
        self._thread = threading.Thread(target=self._run, name="palpate device", daemon=True)
        self._thread.start()

    def command(self, command: tuple[float, ...]) -> None:
        """Set what the device is to do from now on. Returns at once."""
        self._command = command, time.monotonic_ns()

    def sample(self) -> DeviceSample | None:
        """The newest answer, extrapolated to now; None before the first. Returns at once. DeviceError: it is gone."""
        if self._fault is not None:
            raise self._fault
        sample, rates = self._newest
        return sample if sample is None or not sample.homed else ahead(sample, rates, time.monotonic_ns())

    def notes(self) -> list[str]:
        """What the user should see; each line is given once."""
        notes, self._notes = self._notes, []
        return notes

    def stop(self) -> None:
        """Command zero and close the device."""
        self._stop.set()
        if self._thread is not None:
            for _ in range(GLANCES):  # a machine that stands still uses up one of them
                self._thread.join(STOP / GLANCES)
            self._thread = None

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._talk()
            except DeviceError as error:
                if not (self.reconnect and error.lost):
                    self._fault = error
                    break
                self._wait_for_it(error)
            except Exception as error:  # a thread that died silently would leave the last command standing
                self._fault = DeviceError(f"the driver failed: {type(error).__name__}: {error}")
                break
        with contextlib.suppress(Exception):
            for _ in range(FAREWELL):
                self.driver.cycle((0.0,) * self.driver.size)
        with contextlib.suppress(Exception):
            self.driver.close()

    def _talk(self) -> None:
        begun = then = time.monotonic()
        answers, silent, limit = self.answers, 0.0, self.driver.limits.silence
        while not self._stop.is_set():
            command, given = self._command
            sample = self.driver.cycle(self.guard.apply(command, time.monotonic_ns(), given))
            self.guard.saw(sample)
            self.cycles += 1
            now = time.monotonic()
            silent += min(now - then, limit / LEAST)  # a machine that stands still does not use up all of it
            then = now
            if sample is None:
                if silent > limit:
                    raise DeviceError(
                        f"the {self.driver.name} does not answer any more: nothing came for {limit:g} s. Check its"
                        " power and connection.",
                        lost=True,
                    )
                continue
            self._newest = sample, self.guard.rates()
            self.answers += 1
            if silent > PAUSE:
                begun, answers = now, self.answers
            elif now - begun > RATED:
                self.rate = (self.answers - answers) / (now - begun)
                begun, answers = now, self.answers
            silent = 0.0

    def _wait_for_it(self, error: DeviceError) -> None:
        self._notes.append(f"{error} Waiting until it is back.")
        self.lost = error
        if self._newest[0] is not None:
            self._newest = self._newest[0]._replace(homed=False), ((), ())
        self.guard.reset()
        with contextlib.suppress(Exception):
            self.driver.close()
        while not self._stop.wait(RETRY):
            try:
                self.driver.open()
            except DeviceError:
                continue
            self._notes.append("The device is back.")
            self.lost = None
            return
