"""The thread that communicates with a device: newest command out, newest sample in. The force loop never waits for it.

It passes every command through the guard, sends continuously (some devices need it), reconnects to a lost device if
requested, and fades the force out when it stops.
"""

import contextlib
import threading
import time
from collections import Counter
from typing import ClassVar, Protocol

from palpate.drivers.connected import LEAST
from palpate.drivers.errors import DeviceError
from palpate.drivers.frame import FrameRules, absent
from palpate.drivers.guard import SILENT, DeviceSample, Guard, ahead
from palpate.drivers.limits import Limits

RETRY = 0.5  # [s] between two attempts to reconnect
FAREWELL = 3  # [1] zero commands before the device is closed
FADING = 50  # [1] largest number of commands with which the force fades out before them
STOP, CHECKS = 2.0, 20  # [s] timeout for the thread's end, and number of checks within it
RATED = 1.0  # [s] averaging time of the rate of answers
PAUSE = 0.1  # [s] a longer time without an answer is an outage and does not count for the rate


class Driver(Protocol):
    """Direct access to one device. Only one thread at a time calls its methods."""

    name: ClassVar[str]
    limits: Limits
    rules: ClassVar[FrameRules]
    """What its frames say about themselves. Frames that are no samples are counted by reason in `refused`."""
    size: int
    """Number of values in a command; 0: a sensor."""

    def open(self) -> None:
        """Find and initialise the device. DeviceError: not possible; says what to do."""

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        """Send a command and return one answer; None if none arrived within a few periods. The answer is `frame.absent`
        if the numbers of a frame are invalid by `rules`.

        DeviceError: the device is lost.
        """

    def close(self) -> None:
        """Release the device. It may be lost already."""


class Exchange:
    """Runs a driver in a separate thread.

    driver     the device; `start` calls its `open` in the caller's thread
    guard      limits its commands
    reconnect  whether to wait for a lost device; otherwise `sample` raises the error
    """

    def __init__(self, driver: Driver, guard: Guard, *, reconnect: bool = False) -> None:
        self.driver, self.guard, self.reconnect = driver, guard, reconnect
        self._command: tuple[tuple[float, ...], int] = ((0.0,) * driver.size, 0)
        self._newest: tuple[DeviceSample | None, tuple[tuple[float, ...], tuple[float, ...]]] = None, ((), ())
        self._fault: DeviceError | None = None
        self.lost: DeviceError | None = None  # the error, while waiting for a lost device
        self._notes: list[str] = []
        self._reported: dict[str, int] = {}
        self._silent = 0  # requests for the force of a sensor while it was silent
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.answers = 0
        self.rate = 0.0  # [Hz] of the device's answers over the last second in which it answered

    def start(self) -> None:
        """Open the device and start the thread. DeviceError: it cannot be opened."""
        self.driver.open()
        self._thread = threading.Thread(target=self._run, name="palpate device", daemon=True)
        self._thread.start()

    def command(self, command: tuple[float, ...]) -> None:
        """Set the command to send from now on. Returns at once."""
        self._command = command, time.monotonic_ns()

    def sample(self) -> DeviceSample | None:
        """The newest answer, extrapolated to now; None before the first. Returns at once. DeviceError: device lost."""
        if self._fault is not None:
            raise self._fault
        sample, rates = self._newest
        now = time.monotonic_ns()
        if sample is not None and not self.driver.size and now - sample.time > self._longest() * 1e9:
            self._silent += 1
            return absent(now)  # the last force of a sensor is not the present one
        return sample if sample is None or not sample.homed else ahead(sample, rates, now)

    def _longest(self) -> float:
        """Age [s] from which the sample of a sensor does not count: SILENT, or 3 periods of a slow sensor, as for the
        inputs of nodes."""
        return max(SILENT, 3.0 / self.rate if self.rate > 0.0 else 0.0)

    def notes(self) -> list[str]:
        """New lines for the user; each is returned once."""
        notes, self._notes = self._notes, []
        return notes + self._refusals()

    def _refusals(self) -> list[str]:
        """Each reason for which answers are left out: at its first one, and the total at the end."""
        refused = getattr(self.driver, "refused", None)  # a driver of a user may have none
        counted: dict[str, int] = dict(refused) if isinstance(refused, Counter) else {}
        counts = {f"answers {why}: left out": count for why, count in counted.items()}
        if self._silent:
            counts["steps in which the sensor was silent: no force"] = self._silent
        ended, notes = self._stop.is_set(), []
        for text, count in counts.items():
            if text not in self._reported or (ended and count > self._reported[text]):
                notes.append(f"the {self.driver.name}: {count} {text}" + ("" if ended else "; more are counted"))
                self._reported[text] = count
        return notes

    def stop(self) -> None:
        self._stop.set()
        if self._thread is not None:
            for _ in range(CHECKS):  # a stall of the machine uses up one of them
                self._thread.join(STOP / CHECKS)
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
            except Exception as error:  # if the thread died silently, the last command would stay active
                self._fault = DeviceError(f"the driver failed: {type(error).__name__}: {error}")
                break
        with contextlib.suppress(Exception):
            self._fade()
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
            self.guard.note_answer(sample)
            now = time.monotonic()
            silent += min(now - then, limit / LEAST)  # a stall of the machine does not use up the limit
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

    def _fade(self) -> None:
        """Send commands that the guard takes for stale ones, until they are zero."""
        command, _ = self._command
        for _ in range(FADING):
            sent = self.guard.apply(command, time.monotonic_ns(), 0)
            if not any(sent):
                return
            self.guard.note_answer(self.driver.cycle(sent))

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
