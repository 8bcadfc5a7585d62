"""A device's driver against an emulator of its protocol."""

import time
from collections.abc import Callable
from typing import Any

import typer

from palpate.drivers.guard import DeviceSample
from palpate.engine.faults import choices
from palpate.launch.load.classes import catalogue
from palpate.nodes.base.wired import Wired


def run(name: str, seconds: float, tell: Callable[[str], None]) -> dict[str, Any]:
    """Run the driver of a device against its emulator, tell of ten samples, and count what comes back. BadParameter."""
    kinds = [entry.cls for entry in catalogue()[0]]
    known = {kind.__name__.lower(): kind for kind in kinds if issubclass(kind, Wired) and kind.paced}
    kind = known.get(name.lower())
    if kind is None:
        raise typer.BadParameter(f"--emulate: found {name!r}. {choices('Devices', name.lower(), sorted(known))}")
    node = kind(port="emulator")
    node.start()
    try:
        end, lines = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            sample = node.talk((0.0,) * node.exchange.driver.size, 1e-3)
            if lines < 10 and time.monotonic() > end - seconds + lines * seconds / 10:
                lines += 1
                tell(_told(sample))
            time.sleep(1e-3)
        return {"ok": node.exchange.answers > 0, "device": kind.__name__, "cycles": node.exchange.cycles,
                "answers": node.exchange.answers, "rate": node.exchange.answers / seconds}  # fmt: skip
    finally:
        node.stop()


def _told(sample: DeviceSample | None) -> str:
    if sample is None:
        return "no answer yet"
    if sample.wrench:
        return "wrench " + ", ".join(f"{w:.3f}" for w in sample.wrench)
    if not sample.homed:
        return "not homed"
    place = ", ".join(f"{1e3 * p:.2f}" for p in sample.position)
    return f"position {place} mm, buttons {sample.buttons:b}"
