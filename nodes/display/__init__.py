"""Display nodes: what the fingerpad feels, as commands of a tactile display, and the displays at the machine. Each is
found by its name in any file of this folder."""

from typing import Any

from palpate.nodes.base.room import class_of
from palpate.nodes.display.pin_array import PinArray, tangent_frame

__all__ = ["PinArray", "tangent_frame"]


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
