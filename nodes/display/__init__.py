"""Display nodes: commands of a tactile display. A class is found by its name in any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.display.pin_array import PinArray, tangent_frame

__all__ = ["PinArray", "tangent_frame"]

__getattr__, __dir__ = room(__name__)
