"""What is plugged into this machine, as the kernel lists it: no library is needed, nothing is opened."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from palpate.drivers.catalogue import Known, fitting
from palpate.physics.extras import install

USB = Path("/sys/bus/usb/devices")
DEV = Path("/dev")


@dataclass(frozen=True)
class Found:
    """One device.

    name, use   what it is or may be, and the node that drives it
    ids         vendor:product
    port        what to give a node as `port`
    file        of the system by which it is reached
    permitted   whether this user may read and write that file
    bound       kernel driver of its first interface; empty: none
    missing     module that has to be installed first; empty: none
    serial      its serial number
    """

    name: str
    use: str
    ids: str
    port: str
    file: str
    permitted: bool
    bound: str
    missing: str
    serial: str

    @property
    def next_step(self) -> str:
        """What stands in the way; empty: nothing."""
        if self.missing:
            return install("devices")
        return "" if self.permitted else "not permitted: palpate devices --install-udev"


def devices() -> Iterator[Found]:
    for folder in sorted(USB.glob("*")) if USB.is_dir() else ():
        kind = fitting(_word(folder / "idVendor"), _word(folder / "idProduct"))
        if kind is not None:
            yield _found(kind, folder)


def _found(kind: Known, folder: Path) -> Found:
    bus, number = _word(folder / "busnum"), _word(folder / "devnum")
    file = DEV / "bus" / "usb" / bus.zfill(3) / number.zfill(3)
    return Found(
        name=kind.name,
        use=kind.use,
        ids=f"{_word(folder / 'idVendor')}:{_word(folder / 'idProduct')}",
        port=f"{bus}:{number}",
        file=str(file),
        permitted=os.access(file, os.R_OK | os.W_OK),
        bound=_bound(folder),
        missing=kind.needs if kind.needs and find_spec(kind.needs) is None else "",
        serial=_word(folder / "serial"),
    )


def _bound(folder: Path) -> str:
    for interface in sorted(folder.glob(f"{folder.name}:*")):
        link = interface / "driver"
        if link.is_symlink():
            return link.resolve().name
    return ""


def _word(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""
