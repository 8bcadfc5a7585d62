"""Devices that only send reports, when somebody touches them: sticks and mice without force."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from palpate.drivers.errors import DeviceError
from palpate.drivers.transport.hid import Hid

PATIENCE = 0.02  # [s] it may be silent while nobody touches it


class Sender(ABC):
    """One of them.

    connect  opens it
    """

    name: ClassVar[str]
    size = 0

    def __init__(self, connect: Callable[[], Hid]) -> None:
        self.connect = connect
        self.device: Hid | None = None

    @abstractmethod
    def take(self, report: bytes) -> None:
        """One report."""

    def listen(self) -> None:
        """Take all reports that have come. DeviceError: it is not open."""
        if self.device is None:
            raise DeviceError(f"the {self.name} is not open", lost=True)
        report = self.device.read(64, PATIENCE)
        while report:
            self.take(report)
            report = self.device.read(64, 0.001)

    def close(self) -> None:
        if self.device is not None:
            device, self.device = self.device, None
            device.close()
