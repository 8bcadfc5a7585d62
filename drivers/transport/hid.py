"""HID reports, by hidapi."""

import os
from collections.abc import Callable
from typing import Any, Protocol

from palpate.drivers.errors import DeviceError, package


class HidPort(Protocol):
    """What a driver needs of a HID device."""

    def write(self, report: bytes) -> None:
        """Send a report without a number. DeviceError: the device is gone."""

    def read(self, size: int, timeout: float) -> bytes:
        """One report, with its number first where it has one; empty when none came within `timeout` [s].

        DeviceError: the device is gone.
        """

    def descriptor(self) -> bytes:
        """The device's own description of its reports; empty where it cannot be had."""

    def close(self) -> None:
        """Give the device back."""


class UsbHid:
    """A HID device of this machine.

    fits  tells of one entry of hidapi's list (a dict with vendor_id, product_id, usage_page, usage ...) whether it is
          the kind
    name  of the kind, for errors
    port  "" where there is only one; else its path (/dev/hidraw3) or serial number
    """

    def __init__(self, fits: Callable[[dict[str, Any]], bool], name: str, port: str = "") -> None:
        self.hid, self.name = package("hid"), name
        entries: dict[str, dict[str, Any]] = {}
        for entry in self.hid.enumerate():
            if fits(entry):
                entries.setdefault(os.fsdecode(entry["path"]), entry)
        chosen = [p for p, e in entries.items() if not port or port in (p, e.get("serial_number"))]
        listed = ", ".join(entries)
        if not entries:
            raise DeviceError(
                f"no {name} on USB or Bluetooth. Plug it in; `palpate devices` shows what is there; `port: emulator`"
                " runs without one."
            )
        if not chosen:
            raise DeviceError(f"no {name} at port {port!r}. There are: {listed}.")
        if len(chosen) > 1:
            raise DeviceError(f"{len(chosen)} devices are a {name}. Say which one with `port`: {listed}.")
        self.path = chosen[0]
        self.device = self.hid.device()
        try:
            self.device.open_path(os.fsencode(self.path))
            self.device.set_nonblocking(True)
        except OSError:
            allowed = os.access(self.path, os.R_OK | os.W_OK)
            why = "it cannot be opened; is another program using it?" if allowed else "no permission."
            cure = "" if allowed else " `palpate devices --install-udev` writes the rule; then plug it in again."
            raise DeviceError(f"the {name} at {self.path}: {why}{cure}") from None

    def _gone(self) -> DeviceError:
        return DeviceError(f"the {self.name} is gone. Plug it in again.", lost=True)

    def write(self, report: bytes) -> None:
        try:
            sent = self.device.write(b"\0" + report)  # report number 0: it has none
        except (OSError, ValueError):
            raise self._gone() from None
        if sent < 0:
            raise self._gone()

    def read(self, size: int, timeout: float) -> bytes:
        try:
            return bytes(self.device.read(size, max(1, round(timeout * 1e3)) if timeout > 0.0 else 0))
        except (OSError, ValueError):
            raise self._gone() from None

    def descriptor(self) -> bytes:
        try:
            return bytes(self.device.get_report_descriptor())
        except (OSError, ValueError, AttributeError):
            return b""

    def close(self) -> None:
        self.device.close()
