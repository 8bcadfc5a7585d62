"""Haply's Inverse3 through the manufacturer's local service (Inverse Service 3), JSON over ws://localhost:10001.

The service sends the state of all its devices, `inverse3[].device_id` and `.state.cursor_position`; a handle is in
`wireless_verse_grip[]`. A force is sent as `inverse3[].commands.set_cursor_force.values`; the service sends the next
state only after a command, which may be zero. Units: m, N.
"""

import json
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

from palpate.drivers.connected import PortDriver, attempts
from palpate.drivers.emulate.faults import EmulatedFaults, FaultSchedule
from palpate.drivers.emulate.hand import EmulatedOperator, Script
from palpate.drivers.errors import DeviceError, package
from palpate.drivers.frame import FOREIGN, FrameRules, absent
from palpate.drivers.guard import DeviceSample
from palpate.drivers.limits import LIMITS
from palpate.drivers.transport.burst import MOST, burst
from palpate.drivers.transport.websocket import WebSocket

NAME = "Haply Inverse service"
ADDRESS = "ws://localhost:10001"
PATIENCE = 0.005  # [s] timeout for a state
FARTHEST = 1e3  # [m] a coordinate beyond it is a fault of the service
ANSWER = 500_000  # [ns] least time between two answers of the emulator; without a limit it would occupy a whole core
CALM = 10  # [1] cycles without backlog after which a state counts as current
ENCODED = "A1"  # the device in an encoded message
STATUS: dict[int | str, str] = {
    "calibrated": "not calibrated", "power_supply": "no power supply", "ready": "not ready", "started": "not started",
}  # fmt: skip
"""Flags of `inverse3[].status`, in messages that have one (docs.haply.co, Inverse SDK, WebSocket protocol)."""
GRIPS = ("wireless_verse_grip", "verse_grip")


def command(device: str, force: tuple[float, ...]) -> str:
    """The message that sets a force [N] (3)."""
    x, y, z = force
    values = {"x": x, "y": y, "z": z}
    return json.dumps({"inverse3": [{"device_id": device, "commands": {"set_cursor_force": {"values": values}}}]})


def state(text: str) -> dict[str, Any]:
    """A message of the service; empty if it is invalid."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return message if isinstance(message, dict) else {}


def entries(message: dict[str, Any], kind: str) -> list[Any]:
    """The devices or handles of a kind in a message."""
    given = message.get(kind)
    return given if isinstance(given, list) else []


def position(device: dict[str, Any]) -> tuple[float, float, float] | None:
    """The cursor position [m] of a device's entry; None if a coordinate is missing, no number, not finite, or farther
    than `FARTHEST`."""
    try:
        given = device["state"]["cursor_position"]
        x, y, z = given["x"], given["y"], given["z"]
    except (KeyError, TypeError):
        return None
    if not all(type(each) in (int, float) and abs(each) <= FARTHEST for each in (x, y, z)):
        return None
    return float(x), float(y), float(z)


def status_fault(device: dict[str, Any]) -> str:
    """Why the position of a device's entry is invalid by its status; empty: it is valid, or the entry has no status."""
    status = device.get("status")
    named = [text for name, text in STATUS.items() if isinstance(status, dict) and status.get(name) is False]
    return f"with a status of {', '.join(named)}" if named else ""


def encode(values: Sequence[Any], status: Sequence[str] = (), number: int = 0, measured: int = 0) -> str:
    """A message with one device: its position, and the flags of its status that are false."""
    place = dict(zip("xyz", values, strict=True))
    flags = {str(name): name not in status for name in STATUS}
    device = {"device_id": ENCODED, "state": {"cursor_position": place}, "status": flags}
    return json.dumps({"inverse3": [device]})


def buttons(message: dict[str, Any]) -> int:
    """The mask of the first handle's buttons, in the order of their names."""
    for kind in GRIPS:
        for grip in entries(message, kind):
            state_ = grip.get("state") if isinstance(grip, dict) else None
            pressed = state_.get("buttons") if isinstance(state_, dict) else None
            if isinstance(pressed, dict):
                return sum(1 << i for i, name in enumerate(sorted(pressed)) if pressed[name] is True)
    return 0


class Inverse3Driver(PortDriver[WebSocket]):
    """A device of the service.

    connect  opens the connection
    device   its id; empty: the only one
    """

    name = NAME
    limits = LIMITS["inverse3"]
    size = 3
    rules = FrameRules(("m",), encode, STATUS, good=())

    def __init__(self, connect: Callable[[], WebSocket], device: str = "") -> None:
        super().__init__(connect)
        self.device = device

    def open(self) -> None:
        self.port, self.calm = self.connect(), CALM
        for _ in attempts(2.0):
            first = state(self.port.read(0.2))
            if "inverse3" in first:
                break
        else:
            raise DeviceError(f"the {NAME} reports no devices within 2 s. Is it version 3 of the service?")
        known = [str(d.get("device_id")) for d in entries(first, "inverse3") if isinstance(d, dict)]
        if not known:
            raise DeviceError(f"the {NAME} runs, but knows no Inverse3. Plug it in and give it power.")
        if self.device and self.device not in known:
            raise DeviceError(f"the {NAME} knows no Inverse3 {self.device!r}. It knows: {', '.join(known)}.")
        if len(known) > 1 and not self.device:
            raise DeviceError(f"the {NAME} knows {len(known)} of them. Set `device_id` to one of: {', '.join(known)}.")
        self.chosen = self.device or known[0]

    def cycle(self, command_: tuple[float, ...]) -> DeviceSample | None:
        self.port.write(command(self.chosen, command_))
        texts = burst(self.port.read, PATIENCE)
        self.calm = self.calm + 1 if len(texts) < MOST else 0
        if not texts or self.calm < CALM:
            return None
        message, now = state(texts[-1]), time.monotonic_ns()
        for device in entries(message, "inverse3"):
            if isinstance(device, dict) and str(device.get("device_id")) == self.chosen:
                place, pressed = position(device), buttons(message)
                if why := status_fault(device) or (FOREIGN if place is None else ""):
                    self.refused[why] += 1
                    return absent(now, pressed)
                return DeviceSample(now, position=place or (), buttons=pressed)
        return None


class EmulatedInverse3:
    """What the service reports of a device that a hand holds, and how it answers a message. `force` [N] (3): the last
    commanded one."""

    def __init__(
        self, script: Script | None = None, faults: EmulatedFaults | None = None, *, ids: tuple[str, ...] = ("04EF",),
        waits: bool = False,
    ) -> None:  # fmt: skip
        self.hand, self.days = EmulatedOperator(script or Script(), waits), FaultSchedule(faults or EmulatedFaults())
        self.ids = ids
        self.force = (0.0, 0.0, 0.0)

    def report(self, now: int, *, first: bool = False) -> str:
        """The message with the state at `now` [ns]; the first one of a connection has more."""
        x, y, z = map(float, self.hand.move(lambda place: self.force, now))
        device: dict[str, Any] = {"state": {"cursor_position": {"x": x, "y": y, "z": z}}}
        if first:
            device["config"] = {"handedness": "right"}
        pressed = {name: bool(self.hand.buttons >> i & 1) for i, name in enumerate("abc")}
        devices = [{"device_id": name, **device} for name in self.ids]
        grips = [{"device_id": "61576", "state": {"buttons": pressed}}]
        return json.dumps({"inverse3": devices, "wireless_verse_grip": grips})

    def answer(self, text: str, opened: int, now: int) -> str | None:
        """The answer to a message at `now` [ns], over a connection since `opened` [ns]: empty if it is lost or the
        service is silent; None: the device was unplugged."""
        if not self.hand.waits:
            self.days.begin(now)
        if self.days.was_unplugged(opened, now):
            return None
        self.hand.begin(now)
        for device in entries(state(text), "inverse3"):
            if device.get("device_id") == self.ids[0]:
                given = device["commands"]["set_cursor_force"]["values"]
                self.force = given["x"], given["y"], given["z"]
        if self.days.silent(now):
            return ""
        return self.days.spoil(self.report(now).encode()).decode(errors="replace")

    def due(self, now: int, answered: int) -> int:
        """Time [ns] of the answer to a message at `now` [ns], after one at `answered` [ns]."""
        return max(now + round(self.days.faults.latency * 1e9), answered + ANSWER)


class EmulatedService(EmulatedInverse3):
    """Emulator of the service on a port of this machine. `address`: its URL."""

    def __init__(
        self, script: Script | None = None, faults: EmulatedFaults | None = None, *, ids: tuple[str, ...] = ("04EF",),
        waits: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(script, faults, ids=ids, waits=waits)
        self.errors = package("websockets.exceptions")
        self.server = package("websockets.sync.server").serve(self._serve, "127.0.0.1", 0, compression=None)
        self.address = f"ws://127.0.0.1:{self.server.socket.getsockname()[1]}"
        threading.Thread(target=self.server.serve_forever, name="emulated Inverse service", daemon=True).start()

    def _serve(self, link: Any) -> None:
        opened = answered = time.monotonic_ns()
        try:
            link.send(self.report(opened, first=True))
            for text in link:
                now = time.monotonic_ns()
                answer = self.answer(text, opened, now)
                if answer is None:
                    return
                if not answer:
                    continue
                due, answered = self.due(now, answered), time.monotonic_ns()
                if due > answered:
                    time.sleep((due - answered) * 1e-9)
                    answered = due
                link.send(answer)
        except (self.errors.ConnectionClosed, KeyError, TypeError):
            return

    def close(self) -> None:
        self.server.shutdown()
