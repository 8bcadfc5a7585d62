"""Display nodes: what the fingerpad feels, as commands of a tactile display, and the displays at the machine."""

from typing import Any

from palpate.nodes.display.pin_array import PinArray, tangent_frame

__all__ = ["DotPad", "InForm", "PinArray", "tangent_frame"]


def __getattr__(name: str) -> Any:
    """`display.InForm` and `display.DotPad`, brought in when they are asked for."""
    if name in ("DotPad", "InForm"):
        from palpate.nodes.display import wired

        return getattr(wired, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
