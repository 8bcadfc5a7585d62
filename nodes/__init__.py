"""One file or folder per job: settings, ports and state of the nodes; the formulas are in `physics`."""

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
    "SettingError", "Stream", "Switch", "Wants", "part",
]  # fmt: skip
