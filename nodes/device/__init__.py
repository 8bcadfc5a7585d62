"""Devices: the nodes that stand where hardware is bound in."""

from typing import Any

from palpate.nodes.device.simulated import Segment, Simulated

_ELSEWHERE = {
    "Falcon": "falcon",
    "Haply2Diy": "haply",
    "Hid": "hid",
    "Inverse3": "haply",
    "RawHid": "hid",
    "Replayed": "replayed",
}
__all__ = ["Falcon", "Haply2Diy", "Hid", "Inverse3", "RawHid", "Replayed", "Segment", "Simulated"]


def __getattr__(name: str) -> Any:
    """A device of a file that is read when it is asked for: a graph with one device needs no other."""
    from importlib import import_module

    if name in _ELSEWHERE:
        return getattr(import_module(f"{__name__}.{_ELSEWHERE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
