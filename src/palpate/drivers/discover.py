"""Lists connected USB devices that palpate supports, from the kernel's files, without a library or opening them; and
the udev rule that permits a user to open them."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from palpate.drivers import falcon
from palpate.physics.extras import install

USB = Path("/sys/bus/usb/devices")
DEV = Path("/dev")
RULE = "/etc/udev/rules.d/70-palpate.rules"


class Known(NamedTuple):
    """A kind of device.

    name, use        the manufacturer's name, and the node that drives it
    vendor, product  USB ids, four hexadecimal digits
    needs            module that the driver imports
    through          "usb" or "hidraw": kind of its device file
    """

    name: str
    use: str
    vendor: str
    product: str
    needs: str
    through: str


KNOWN = (
    Known(falcon.NAME, "device.Falcon", f"{falcon.VENDOR:04x}", f"{falcon.PRODUCT:04x}", "usb", "usb"),
    Known("raw-HID device (Teensy)", "device.RawHid", "16c0", "0486", "hid", "hidraw"),
)


@dataclass(frozen=True)
class ConnectedDevice:
    """One connected device.

    name, use   its kind, and the node that drives it
    ids         vendor:product
    port        value of the node's setting `port`
    file        device file; empty: the kernel has none
    permitted   whether this user may read and write that file
    missing     module that has to be installed first; empty: none
    serial      serial number
    """

    name: str
    use: str
    ids: str
    port: str
    file: str
    permitted: bool
    missing: str
    serial: str

    @property
    def next_step(self) -> str:
        """What the user must do first; empty: nothing."""
        if self.missing:
            return install("devices")
        if not self.file:
            return "no hidraw file: another program uses the device; end it, then plug the device in again"
        return "" if self.permitted else "not permitted: palpate devices --install-udev"


def devices() -> Iterator[ConnectedDevice]:
    for folder in sorted(USB.glob("*")) if USB.is_dir() else ():
        ids = _word(folder / "idVendor"), _word(folder / "idProduct")
        yield from (_find_devices(k, folder) for k in KNOWN if (k.vendor, k.product) == ids)


def _find_devices(kind: Known, folder: Path) -> ConnectedDevice:
    bus, number = _word(folder / "busnum"), _word(folder / "devnum")
    if kind.through == "usb":
        file, port = str(DEV / "bus" / "usb" / bus.zfill(3) / number.zfill(3)), f"{bus}:{number}"
    else:  # of the first interface
        file = port = next((str(DEV / hidraw.name) for hidraw in sorted(folder.glob("*/*/hidraw/hidraw*"))), "")
    return ConnectedDevice(
        name=kind.name,
        use=kind.use,
        ids=f"{kind.vendor}:{_word(folder / 'idProduct')}",
        port=port,
        file=file,
        permitted=os.access(file, os.R_OK | os.W_OK),
        missing=kind.needs if find_spec(kind.needs) is None else "",
        serial=_word(folder / "serial"),
    )


def _word(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def udev_rules() -> str:
    """The text of a rules file that permits the local user and the group plugdev to use all known devices."""
    lines = ["# Devices that palpate drives. After a change: udevadm control --reload, then plug the device in again."]
    for kind in KNOWN:
        lines.append(f"# {kind.name}: {kind.use}")
        ids = f'ATTRS{{idVendor}}=="{kind.vendor}", ATTRS{{idProduct}}=="{kind.product}"'
        lines.append(f'SUBSYSTEM=="{kind.through}", {ids}, MODE="0660", GROUP="plugdev", TAG+="uaccess"')
    return "\n".join(lines) + "\n"
