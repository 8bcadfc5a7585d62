"""Devices that only send reports, when somebody touches them: sticks and mice without force."""

from abc import ABC, abstractmethod

from palpate.drivers.connected import PortDriver
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.hid import HidPort

PATIENCE = 0.02  # [s] it may be silent while nobody touches it


class HidSender(PortDriver[HidPort], ABC):
    size = 0

    @abstractmethod
    def take(self, report: bytes) -> None:
        """One report."""

    def listen(self) -> None:
        """Take the reports that have come. DeviceError: it is not open."""
        port = self.port
        for report in burst(lambda timeout: port.read(64, timeout), PATIENCE):
            self.take(report)
