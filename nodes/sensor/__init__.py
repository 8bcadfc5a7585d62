"""Force sensors: the finger's force when no simulated contact makes it."""

from typing import Any

from palpate.nodes.sensor.force_sensor import ForceSensor

__all__ = ["Bota", "ForceSensor", "NetFT"]


def __getattr__(name: str) -> Any:
    """`sensor.NetFT` and `sensor.Bota`, brought in when they are asked for."""
    if name in ("Bota", "NetFT"):
        from palpate.nodes.sensor import measured

        return getattr(measured, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
