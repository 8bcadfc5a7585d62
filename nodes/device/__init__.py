"""Devices: interfaces to hardware, and simulated ones. A class is found by its name in any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.device.path import Segment
from palpate.nodes.device.simulated import Simulated

__all__ = ["Segment", "Simulated"]

__getattr__, __dir__ = room(__name__)
