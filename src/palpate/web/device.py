"""The raw-HID device of a run as data for the page: its reports, the rules of its frames and those of the guard.

The page exchanges the reports by WebHID (`static/raw_hid.js`, `static/guard.js`); all numbers come from the driver.
"""

from __future__ import annotations

import math
import struct
from dataclasses import asdict
from typing import Any

from palpate.drivers import exchange, guard
from palpate.drivers.connected import LEAST
from palpate.drivers.hid import raw
from palpate.engine.slot import Slot

HID = {"usagePage": raw.USAGE_PAGE, "usage": raw.USAGE}
"""What a browser looks for."""


def describe_device(slot: Slot) -> dict[str, Any]:
    """The device of a started `device.RawHid`: the stream and field of its command, and all that its host obeys."""
    node: Any = slot.node
    (port,) = (each for each in slot.inputs if not each.dead)  # the other one is not connected
    watch: guard.Guard = node.exchange.guard
    return {
        "command": {"stream": port.stream, "field": {"force": "force", "torque": "torques"}[port.port.name]},
        "protocol": describe_protocol(),
        "guard": describe_guard(watch),
        "exchange": {"patience": raw.PATIENCE, "silence": watch.limits.silence, "least": LEAST,
                     "fading": exchange.FADING, "farewell": exchange.FAREWELL, "horizon": guard.HORIZON},
    }  # fmt: skip


def describe_protocol() -> dict[str, Any]:
    """The reports of docs/raw_hid.md, by the table of the driver: of each field its type, place and number."""
    rules = raw.RawHidDriver.rules
    return {
        "length": raw.LENGTH, "magic": raw.MAGIC, "version": raw.VERSION, "watchdog": raw.WATCHDOG,
        "flags": {"enable": raw.ENABLE, "home": raw.HOME, "ask": raw.ASK_INFO, "homed": raw.HOMED, "fault": raw.FAULT,
                  "torques": raw.TORQUES},
        "numbers": rules.numbers, "counts": list(rules.counts), "axes": raw.RawHidDriver.size,
        "reports": {name: {"kind": kind, "fields": _places(fields)} for name, (kind, fields) in raw.REPORTS.items()},
    }  # fmt: skip


def _places(fields: tuple[tuple[str, str, int], ...]) -> dict[str, dict[str, Any]]:
    """Type, place [bytes] and number of each field; the first two bytes are the magic number and the kind."""
    places, at = dict[str, dict[str, Any]](), 2
    for name, code, count in fields:
        places[name] = {"type": code, "at": at, "count": count}
        at += struct.calcsize(f"<{count}{code}")
    return places


def describe_guard(watch: guard.Guard) -> dict[str, Any]:
    """The limits of a guard and its times [s]; numbers without a bound are None."""
    limits = asdict(watch.limits) | {"box": [[_finite(x) for x in corner] for corner in watch.limits.box]}
    return {
        "limits": {name: _finite(value) if isinstance(value, float) else value for name, value in limits.items()},
        "deadman": watch.deadman, "ramp": watch.ramp, "fall": guard.FALL, "missed": guard.MISSED,
        "silent": guard.SILENT, "stale": guard.STALE, "history": guard.HISTORY,
    }  # fmt: skip


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
