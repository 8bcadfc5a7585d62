"""Direct USB access to an FTDI serial chip: control requests, bulk out, bulk in with two modem bytes per packet.

Requests and values as in the drivers of FTDI, libftdi and Linux (ftdi_sio). The kernel's serial driver is detached,
since it cannot set the baud divisors of a Falcon.
"""

import errno
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from palpate.drivers.connected import select_device
from palpate.drivers.errors import DeviceError, package

OUT, IN = 0x02, 0x81  # endpoints
PACKET = 64  # [bytes] of a full-speed packet, of which two are modem status
TIMEOUT = 1000  # [ms] of control requests and writes

RESET, MODEM, FLOW, BAUD, DATA, LATENCY = 0, 1, 2, 3, 4, 9  # requests
PURGE_RX, PURGE_TX = 1, 2  # values of RESET
DTR_LOW, DTR_HIGH, RTS_LOW = 0x0100, 0x0101, 0x0200  # values of MODEM
BITS_8N1 = 8  # value of DATA


class Ftdi(Protocol):
    """Interface of the chip."""

    def control(self, request: int, value: int) -> None:
        """Send a vendor request. DeviceError: the device is lost."""

    def write(self, data: bytes) -> None:
        """Send bytes to the line. DeviceError: the device is lost."""

    def read(self, timeout: float) -> bytes:
        """One transfer, modem bytes included; empty if none arrives within `timeout` [s].

        DeviceError: the device is lost.
        """

    def close(self) -> None:
        """Release the chip."""


def payload(transfer: bytes) -> bytes:
    """The bytes of the line in a transfer, without the two modem bytes at the begin of each packet of 64."""
    return b"".join(transfer[i + 2 : i + PACKET] for i in range(0, len(transfer), PACKET))


class UsbFtdi:
    """A chip on this machine's USB, by pyusb.

    vendor, product  USB ids
    name             of the device, for errors
    port             serial number, or bus:address as in `palpate devices`; "": the only device
    backend          of pyusb; None: libusb
    """

    def __init__(self, vendor: int, product: int, name: str, port: str = "", backend: Any = None) -> None:
        self.usb = package("usb.core")
        self.util = package("usb.util")
        self.name = name
        self.device = self._choose(vendor, product, port, backend)
        with suppress(NotImplementedError, self.usb.USBError):  # the claim below reports the error
            if self.device.is_kernel_driver_active(0):
                self.device.detach_kernel_driver(0)
        with self._usb_errors():
            self.util.claim_interface(self.device, 0)

    def _choose(self, vendor: int, product: int, port: str, backend: Any) -> Any:
        try:
            devices = list(self.usb.find(find_all=True, idVendor=vendor, idProduct=product, backend=backend))
        except self.usb.NoBackendError:
            raise DeviceError(
                "libusb, which pyusb needs, is not on this machine. Install it: apt install libusb-1.0-0"
            ) from None
        if not devices:
            raise DeviceError(
                f"no {self.name} on USB ({vendor:04x}:{product:04x}). Plug it in and give it power; `palpate devices`"
                " shows what is there; `port: emulator` runs without one."
            )
        places = {f"{d.bus}:{d.address}": d for d in devices}
        return places[select_device(self.name, port, {place: self._serial(d) for place, d in places.items()})]

    def _serial(self, device: Any) -> str | None:
        try:
            return device.serial_number
        except (ValueError, self.usb.USBError):
            return None  # not permitted, or it has none

    @contextmanager
    def _usb_errors(self) -> Iterator[None]:
        """Turn USB errors into DeviceError with the next step."""
        try:
            yield
        except self.usb.USBError as error:
            if error.errno == errno.EACCES:
                raise DeviceError(
                    f"no permission for the {self.name}. `palpate devices --install-udev` writes the rule; then plug it"
                    " in again."
                ) from None
            if error.errno == errno.EBUSY:
                raise DeviceError(f"the {self.name} is in use by another program. End that one.") from None
            raise DeviceError(f"the {self.name} is gone ({error}). Plug it in again.", lost=True) from None

    def control(self, request: int, value: int) -> None:
        with self._usb_errors():
            self.device.ctrl_transfer(0x40, request, value, 0, None, TIMEOUT)

    def write(self, data: bytes) -> None:
        with self._usb_errors():
            self.device.write(OUT, data, TIMEOUT)

    def read(self, timeout: float) -> bytes:
        with self._usb_errors(), suppress(self.usb.USBTimeoutError):
            return bytes(self.device.read(IN, PACKET, max(1, round(timeout * 1e3))))
        return b""

    def close(self) -> None:
        self.util.dispose_resources(self.device)
