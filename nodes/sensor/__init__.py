"""Force and tactile sensors: in place of a simulated contact, or on it. A class is found by its name in any file of this
folder."""

from palpate.nodes.base.room import room
from palpate.nodes.sensor.force_sensor import ForceSensor

__all__ = ["ForceSensor"]

__getattr__, __dir__ = room(__name__)
