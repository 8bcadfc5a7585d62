"""Devices: the nodes that stand where hardware is bound in. Each is found by its name in any file of this folder."""

from typing import Any

from palpate.nodes.base.room import class_of
from palpate.nodes.device.hand import Segment
from palpate.nodes.device.simulated import Simulated

__all__ = ["Segment", "Simulated"]


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
