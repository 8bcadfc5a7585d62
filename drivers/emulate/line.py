"""A device at the other end of a serial line: a pseudo-terminal, with real bytes through the kernel's own line."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import time
import tty

from palpate.drivers.emulate import EmulatedDevice
from palpate.drivers.emulate.faults import Days, EmulatedFaults
from palpate.drivers.errors import DeviceError
from palpate.drivers.transport.serial import SerialLine


class EmulatedLine:
    """A pseudo-terminal with a device behind it. `connect` opens its near end as a driver does.

    baud  [1/s]  for the near end
    name  of the device
    """

    def __init__(self, device: EmulatedDevice, baud: int, name: str, faults: EmulatedFaults | None = None) -> None:
        self.device, self.baud, self.name = device, baud, name
        self.days = Days(faults or EmulatedFaults())
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._master = -1

    def connect(self) -> EmulatedLine.Near:
        """Open the line. DeviceError: it is unplugged."""
        if self.days.unplugged(time.monotonic_ns()):
            raise DeviceError(f"the {self.name}: no such port: the emulated one is unplugged")
        self.close()
        self._stop.clear()
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        path = os.ttyname(slave)
        line = EmulatedLine.Near(path, self.baud, self.name)
        os.close(slave)
        line.owner = self
        self._thread = threading.Thread(target=self._run, name=f"emulated {self.name}", daemon=True)
        self._thread.start()
        return line

    class Near(SerialLine):
        """The near end: pyserial on the pseudo-terminal."""

        owner: EmulatedLine

        def close(self) -> None:
            super().close()
            self.owner.close()

    def _run(self) -> None:
        master, due, opened = self._master, time.monotonic(), time.monotonic_ns()
        with contextlib.suppress(OSError):
            while not self._stop.is_set():
                now, period = time.monotonic_ns(), self.device.period
                if self.days.lost(opened, now):
                    break
                wait = 0.02 if period <= 0.0 else max(0.0, min(due - now * 1e-9, 0.02))
                ready, _, _ = select.select([master], [], [], wait)
                said: list[bytes] = []
                if ready:
                    said += self.device.hear(os.read(master, 4096), time.monotonic_ns())
                if period > 0.0 and time.monotonic() >= due:
                    said.append(self.device.say(time.monotonic_ns()))
                    due = max(due + period, time.monotonic() - period)
                self._send(master, said)
        with contextlib.suppress(OSError):
            os.close(master)

    def _send(self, master: int, said: list[bytes]) -> None:
        for data in said:
            if not data:
                continue
            now = time.monotonic_ns()
            self.days.begin(now)
            if self.days.silent(now):
                continue
            if self.days.faults.latency > 0.0:
                self._stop.wait(self.days.faults.latency)
            spoilt = self.days.spoil(data)
            if spoilt:
                os.write(master, spoilt)

    def close(self) -> None:
        self._stop.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(1.0)
            self._thread = None
