"""ATI's Net F/T: force and torque over UDP, by its Raw Data Transfer.

A request is `>HHI`: 0x1234, the command, number of samples (0: unlimited). A sample is `>III6i`: its number, the
sensor's number, status, and six counts. Counts per unit of force and torque, and the units, are in its /netftapi2.xml.
"""

import contextlib
import http.server
import socket
import struct
import threading
import time
import urllib.error
import urllib.request
import xml.etree.ElementTree as xml
from collections.abc import Callable, Sequence
from typing import NamedTuple

from palpate.drivers.connected import PortDriver
from palpate.drivers.emulate.faults import EmulatedFaults, FaultSchedule
from palpate.drivers.errors import DeviceError
from palpate.drivers.frame import FROZEN, LATE, SATURATED, FrameOrder, FrameRules, Measured, absent
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import Limits
from palpate.drivers.transport.burst import burst
from palpate.drivers.transport.udp import Udp
from palpate.units.header import factor
from palpate.units.symbols import UnitError

NAME = "Net F/T"
PORT = 49152
REQUEST, SAMPLE = struct.Struct(">HHI"), struct.Struct(">III6i")
MAGIC, STOP, STREAM = 0x1234, 0, 2
PATIENCE = 0.05  # [s] timeout for a sample
RENEW = 1.0  # [s] of silence after which the stream is requested again
STATUS: dict[int | str, str] = {
    1 << 0: "temperature out of range", 1 << 1: "supply voltage out of range", 1 << 2: "broken gauge",
    1 << 3: "busy, which affects the data", 1 << 5: "hardware error", 1 << 7: "calibration not accessible",
    1 << 27: "gauge out of range", 1 << 28: "simulated error", 1 << 29: "calibration checksum",
    1 << 30: "force or torque out of range", 1 << 31: "error",
}  # fmt: skip
"""Bits of the status word: ATI, manual 9610-05-Ethernet Axia-09, table 4.7; 9620-05-C-Ethernet Axia-02, table 5.7. In
the older Net Box the lower bits have other meanings, and all of them are errors too."""
LATCHED, ANY = 1 << 16, 1 << 31  # a monitor condition, which the user has set, is no error; it also sets bit 31
LARGEST_COUNT = (1 << 31) - 1


class Scale(NamedTuple):
    """Force [N] and torque [N m] per count."""

    force: float
    torque: float


LEAST, MOST = 1e-9, 1e12  # [1] plausible counts per unit; real sensors have 1e3 to 1e9


def scale(text: bytes) -> Scale:
    """The scale from a sensor's web page. DeviceError: it has none."""
    try:
        page = {element.tag: (element.text or "").strip() for element in xml.fromstring(text).iter()}
        force, torque = float(page["cfgcpf"]), float(page["cfgcpt"])
    except (xml.ParseError, KeyError, ValueError):
        raise DeviceError(
            f"the {NAME}'s /netftapi2.xml has no counts per force and torque (cfgcpf, cfgcpt). Is this a {NAME}?"
        ) from None
    units = page.get("scfgfu", "N"), page.get("scfgtu", "Nm")
    try:
        factors = factor(units[0], "N"), factor(units[1].replace("-", "·"), "N m")  # `lbf-in`
    except UnitError:
        factors = 0.0, 0.0
    if not (all(factors) and LEAST < force < MOST and LEAST < torque < MOST):
        raise DeviceError(
            f"the {NAME} measures {force:g} counts a {units[0]!r} and {torque:g} a {units[1]!r}. Set it to N and Nm on"
            " its web page."
        )
    return Scale(factors[0] / force, factors[1] / torque)


def encode(values: Sequence[int], status: int = 0, number: int = 0, measured: int = 0) -> bytes:
    """A sample: six counts, status word, its number, and that of the measurement."""
    return SAMPLE.pack(number, measured, status, *values)


class NetFTDriver(PortDriver[Udp]):
    """The sensor at an address.

    host  address of the sensor
    rdt   UDP port
    web   HTTP port
    """

    name = NAME
    limits = Limits(0.0, 0.0, float("inf"), silence=2.5 * RENEW)
    size = 0
    rules = FrameRules(
        ("N", "N m"), encode, STATUS, valid=(0, LATCHED, LATCHED | ANY), numbers=1 << 32, measured=1 << 32,
        counts=(-LARGEST_COUNT, LARGEST_COUNT - 1),
    )  # fmt: skip

    def __init__(self, host: str, rdt: int = PORT, web: int = 80) -> None:
        super().__init__(lambda: Udp(host, rdt, NAME))
        self.host, self.web = host, web
        self.order, self.measured = FrameOrder(self.rules), Measured()

    @property
    def lost(self) -> int:
        """[1] Samples missing in the sequence."""
        return self.order.lost

    def open(self) -> None:
        if not self.host:
            raise DeviceError(f"the {NAME} is on the network: give its address as `port`, 192.168.1.1 as delivered.")
        self.scale = scale(self._page())
        self.port = self.connect()
        self._ask(STREAM)

    def _page(self) -> bytes:
        try:
            with urllib.request.urlopen(f"http://{self.host}:{self.web}/netftapi2.xml", timeout=2.0) as page:
                return page.read(1 << 20)
        except (urllib.error.URLError, OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise DeviceError(
                f"no {NAME} at {self.host}: {reason}. Ping it; as delivered it is 192.168.1.1, and this machine needs"
                " an address in the same network."
            ) from None

    def _ask(self, command: int) -> None:
        self.port.write(REQUEST.pack(MAGIC, command, 0))
        self.order.restart()  # a sensor numbers the samples of each request from 1
        self.asked = time.monotonic()

    def cycle(self, command: tuple[float, ...]) -> DeviceSample | None:
        newest = None
        for data in burst(self.port.read, PATIENCE):
            if len(data) != SAMPLE.size:
                continue
            if self.order.take(SAMPLE.unpack(data)[0]):
                newest = data
            else:
                self.refused[LATE] += 1
        if newest is None:
            if time.monotonic() - self.asked > RENEW:
                self._ask(STREAM)
            return None
        self.asked = time.monotonic()
        return self._sample(*SAMPLE.unpack(newest))

    def _sample(self, _: int, measured: int, status: int, *counts: int) -> DeviceSample:
        now = time.monotonic_ns()
        at = self.measured.arrival(measured, now)
        why = self.rules.fault(status) or (SATURATED if self.rules.saturated(counts) else "")
        why = why or (FROZEN if self.measured.frozen(now) else "")
        if why:
            self.refused[why] += 1
            return absent(now)
        force, torque = self.scale
        return DeviceSample(at, wrench=(*(c * force for c in counts[:3]), *(c * torque for c in counts[3:])))

    def close(self) -> None:
        with contextlib.suppress(DeviceError):
            self.port.write(REQUEST.pack(MAGIC, STOP, 0))
        super().close()


class EmulatedSensor:
    """The samples of the sensor.

    wrench  returns the load at a time [ns]: three forces [N], three torques [N m]
    rate    [Hz] sample rate
    """

    COUNTS = 1_000_000

    def __init__(
        self, wrench: Callable[[int], tuple[float, ...]], faults: EmulatedFaults | None = None, rate: float = 1000.0
    ) -> None:
        self.wrench, self.rate, self.days = wrench, rate, FaultSchedule(faults or EmulatedFaults())
        self.number = 0

    def sample(self, now: int) -> bytes:
        """The next sample at `now` [ns]; empty if it is lost or the sensor is silent."""
        self.number = self.number + 1 & 0xFFFFFFFF
        self.days.begin(now)
        if self.days.silent(now) or self.days.is_unplugged(now) or self.days.chance("dropouts"):
            return b""
        return encode([round(w * self.COUNTS) for w in self.wrench(now)], 0, self.number, self.number)


class EmulatedNetFT(EmulatedSensor):
    """Emulator of the sensor on this machine: its UDP port and its web page. Arguments: as of EmulatedSensor."""

    def __init__(
        self, wrench: Callable[[int], tuple[float, ...]], faults: EmulatedFaults | None = None, rate: float = 1000.0
    ) -> None:
        super().__init__(wrench, faults, rate)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.page = http.server.ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self.rdt, self.web = self.socket.getsockname()[1], self.page.server_address[1]
        self._stop = threading.Event()
        for target in (self._run, self.page.serve_forever):
            threading.Thread(target=target, name="emulated Net F/T", daemon=True).start()

    def driver(self) -> NetFTDriver:
        return NetFTDriver("127.0.0.1", self.rdt, self.web)

    def _handler(self) -> type[http.server.BaseHTTPRequestHandler]:
        text = (
            f"<?xml version='1.0'?><netft><prodname>Emulated Net F/T</prodname><cfgcpf>{self.COUNTS}</cfgcpf>"
            f"<cfgcpt>{self.COUNTS}</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><comrdtrate>{self.rate:.0f}</comrdtrate>"
            "</netft>"
        ).encode()

        class Page(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                right = self.path == "/netftapi2.xml"
                self.send_response(200 if right else 404)
                self.end_headers()
                self.wfile.write(text if right else b"")

            def log_message(self, *_: object) -> None:
                pass

        return Page

    def _run(self) -> None:
        peer, due = None, time.monotonic()
        while not self._stop.is_set():
            self.socket.settimeout(max(due - time.monotonic(), 1e-4) if peer is not None else 0.05)
            with contextlib.suppress(TimeoutError, OSError):
                data, sender = self.socket.recvfrom(64)
                if len(data) == REQUEST.size and REQUEST.unpack(data)[0] == MAGIC:
                    peer = sender if REQUEST.unpack(data)[1] == STREAM else None
            now = time.monotonic_ns()
            if peer is None or now * 1e-9 < due:
                continue
            due = max(due + 1.0 / self.rate, now * 1e-9 - 0.01)
            if data := self.sample(now):
                with contextlib.suppress(OSError):
                    self.socket.sendto(data, peer)

    def close(self) -> None:
        self._stop.set()
        self.page.shutdown()
        self.page.server_close()
        self.socket.close()
