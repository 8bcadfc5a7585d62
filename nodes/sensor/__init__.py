"""Force and tactile sensors, in place of a simulated contact or on it; a class is found by its name in any file."""

from palpate.nodes.base.room import room
from palpate.nodes.sensor.force_sensor import ForceSensor

__all__ = ["ForceSensor"]

__getattr__, __dir__ = room(__name__)
