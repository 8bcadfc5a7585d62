"""Devices that only send reports, when somebody touches them: sticks and mice without force."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from palpate.drivers.errors import DeviceError
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.hid import HidPort

PATIENCE = 0.02  # [s] it may be silent while nobody touches it


class HidSender(ABC):
    """One of them.

    connect  opens it
    """

    name: ClassVar[str]
    size = 0

    def __init__(self, connect: Callable[[], HidPort]) -> None:
        self.connect = connect
        self.device: HidPort | None = None

    @abstractmethod
    def take(self, report: bytes) -> None:
        """One report."""

    def listen(self) -> None:
        """Take the reports that have come. DeviceError: it is not open."""
        device = self.device
        if device is None:
            raise DeviceError(f"the {self.name} is not open", lost=True)
        for report in burst(lambda timeout: device.read(64, timeout), PATIENCE):
            self.take(report)

    def close(self) -> None:
        if self.device is not None:
            device, self.device = self.device, None
            device.close()
