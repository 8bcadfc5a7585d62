"""Force sensors: the finger's force when no simulated contact makes it. Each is found by its name in any file of this
folder."""

from typing import Any

from palpate.nodes.base.room import class_of
from palpate.nodes.sensor.force_sensor import ForceSensor

__all__ = ["ForceSensor"]


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
