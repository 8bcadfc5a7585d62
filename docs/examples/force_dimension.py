"""A driver over a vendor's library: Force Dimension's devices through libdhd (docs/vendor_devices.md).

palpate run cartesian --set device.use=force_dimension.ForceDimension
"""

import ctypes
import sys
import time

from palpate.drivers.errors import DeviceError
from palpate.drivers.frame import FrameRules
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import Limits
from palpate.messages import DeviceState, Force
from palpate.nodes.device.hardware import Hardware, state

LIBRARY = {"win32": "dhd64.dll", "darwin": "libdhd.dylib"}.get(sys.platform, "libdhd.so")
WATCHDOG = 160  # [125 µs] without a new force the device switches its motors off: 20 ms


class DhdDriver:
    """The first device that libdhd finds."""

    name, size = "Force Dimension device", 3
    rules = FrameRules(units=("m",))  # libdhd checks the frames of the device
    limits = Limits(5.0, 5.0, 1.5, delay=3)  # 5 N, 5 W, 1.5 m/s: chosen for careful use, below the device's limits

    def __init__(self, path: str) -> None:
        self.path, self.id = path or LIBRARY, -1

    def open(self) -> None:
        try:
            self.sdk = ctypes.CDLL(self.path)
        except OSError as error:
            raise DeviceError(f"found no {self.path}: {error}. Install the SDK, or set `port` to its path.") from None
        self.sdk.dhdSetForce.argtypes = *[ctypes.c_double] * 3, ctypes.c_char
        self.id = ctypes.c_char(self.sdk.dhdOpen() & 255)
        if self.id.value == b"\xff":  # -1
            raise DeviceError("libdhd found no device. Plug it in, switch it on, and close other programs that use it.")
        self.sdk.dhdSetWatchdog(ctypes.c_ubyte(WATCHDOG), self.id)
        self.sdk.dhdEnableForce(ctypes.c_ubyte(1), self.id)

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        if self.sdk.dhdSetForce(*command, self.id) < 0:
            raise DeviceError("the device refused a force; is it unplugged?", lost=True)
        x, y, z = place = ctypes.c_double(), ctypes.c_double(), ctypes.c_double()
        if self.sdk.dhdGetPosition(*map(ctypes.byref, place), self.id) < 0:
            return None
        time.sleep(0.0005)  # at most 2 kHz: one answer for each command of the graph
        return DeviceSample(time.monotonic_ns(), position=(x.value, y.value, z.value))

    def close(self) -> None:
        self.sdk.dhdEnableForce(ctypes.c_ubyte(0), self.id)
        self.sdk.dhdClose(self.id)


class ForceDimension(Hardware):
    """A device of Force Dimension. `port`: the path of libdhd; empty: where the system finds libraries."""

    def driver(self) -> DhdDriver:
        return DhdDriver(self.port)

    def step(self, force: Force | None, *, dt: float) -> DeviceState:
        return state(self.talk(force.force if force is not None else (0.0, 0.0, 0.0), dt))
