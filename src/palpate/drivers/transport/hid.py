"""HID reports through the kernel's hidraw devices, by hidapi."""

import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Protocol

from palpate.drivers.connected import select_device
from palpate.drivers.errors import DeviceError, package


class HidPort(Protocol):
    """Interface of a HID device."""

    def write(self, report: bytes) -> None:
        """Send a report without a number. DeviceError: the device is lost."""

    def read(self, size: int, timeout: float) -> bytes:
        """One report, beginning with its number if it has one; empty if none arrives within `timeout` [s].

        DeviceError: the device is lost.
        """

    def close(self) -> None:
        """Release the device."""


def hidapi() -> Any:
    """hidapi on hidraw: /dev/hidraw paths, usage pages of every entry, and Bluetooth. DeviceError: not installed.

    The wheels have two modules: `hidraw`, and `hid` on libusb, which reports usage page 0 until a device is opened and
    detaches the kernel's driver. A build from source has only `hid`, on hidraw.
    """
    return package("hidraw" if find_spec("hidraw") is not None else "hid")


class UsbHid:
    """A HID device of this machine.

    fits  whether an entry of hidapi's list (a dict with vendor_id, product_id, usage_page, usage ...) is of this kind
    name  of the kind, for errors
    port  path (/dev/hidraw3) or serial number; "": the only device
    """

    def __init__(self, fits: Callable[[dict[str, Any]], bool], name: str, port: str = "") -> None:
        hid, self.name = hidapi(), name
        entries = {os.fsdecode(entry["path"]): entry for entry in hid.enumerate() if fits(entry)}
        if not entries:
            raise DeviceError(
                f"no {name} on USB or Bluetooth. Plug it in; `palpate devices` lists the connected ones;"
                " `port: emulator` runs without one."
            )
        path = select_device(name, port, {path: entry.get("serial_number") for path, entry in entries.items()})
        self.device = hid.device()
        try:
            self.device.open_path(os.fsencode(path))
            self.device.set_nonblocking(True)
        except OSError:
            why = "it cannot be opened; is another program using it?"
            if not os.access(path, os.R_OK | os.W_OK):
                why = "no permission. `palpate devices --install-udev` writes the rule; then plug it in again."
            raise DeviceError(f"the {name} at {path}: {why}") from None

    def _gone_error(self) -> DeviceError:
        return DeviceError(f"the {self.name} is gone. Plug it in again.", lost=True)

    def write(self, report: bytes) -> None:
        try:
            sent = self.device.write(b"\0" + report)  # report number 0: reports without a number
        except (OSError, ValueError):
            raise self._gone_error() from None
        if sent < 0:
            raise self._gone_error()

    def read(self, size: int, timeout: float) -> bytes:
        try:
            return bytes(self.device.read(size, max(1, round(timeout * 1e3)) if timeout > 0.0 else 0))
        except (OSError, ValueError):
            raise self._gone_error() from None

    def close(self) -> None:
        self.device.close()
