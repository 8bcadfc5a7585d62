"""Base classes of nodes: settings, ports, state; and code that several nodes share."""

from palpate.nodes.base.block import Block
from palpate.nodes.base.compiled import ARRAY, TABLE, CompiledNode
from palpate.nodes.base.effect import Agrees, Calibrated, Effect, Follows, Ideal, Part, Switch, effects, part
from palpate.nodes.base.node import (
    InputError,
    Node,
    Observer,
    Out,
    Port,
    Setting,
    SettingError,
    Stream,
    Wants,
    convert,
    inputs,
    outputs,
    plain,
    settings,
)

__all__ = [
    "ARRAY", "TABLE", "Agrees", "Block", "Calibrated", "CompiledNode", "Effect", "Follows", "Ideal", "InputError",
    "Node", "Observer", "Out", "Part", "Port", "Setting", "SettingError", "Stream", "Switch", "Wants", "convert",
    "effects", "inputs", "outputs", "part", "plain", "settings",
]  # fmt: skip
