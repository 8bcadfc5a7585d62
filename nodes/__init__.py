"""One file or folder per job: settings, ports and state of the nodes; the formulas are in `physics`."""

from typing import TYPE_CHECKING, Any

from palpate.nodes.base import (
    ARRAY,
    TABLE,
    Block,
    Calibrated,
    CompiledNode,
    InputError,
    Node,
    Observer,
    Out,
    Part,
    SettingError,
    Stream,
    Switch,
    Wants,
    part,
)

__all__ = [
    "ARRAY", "TABLE", "Block", "Calibrated", "CompiledNode", "InputError", "Node", "Observer", "Out", "Part",
    "SettingError", "Stream", "Switch", "Wants", "ieee_kernel", "kernel", "part",
]  # fmt: skip

if TYPE_CHECKING:
    from palpate.nodes.base.kernels import ieee_kernel, kernel
else:

    def __getattr__(name: str) -> Any:
        """`kernel` and `ieee_kernel`, on first use: the compiler is slow to import."""
        if name in ("ieee_kernel", "kernel"):
            from palpate.nodes.base import kernels

            return getattr(kernels, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
