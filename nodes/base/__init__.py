"""What every node is made of: settings, ports, state; and what several of them share."""

from palpate.nodes.base.effect import Calibrated, Effect, Switch, effects, part
from palpate.nodes.base.node import (
    InputError,
    Node,
    Observer,
    Port,
    Setting,
    SettingError,
    Stream,
    Wants,
    convert,
    inputs,
    outputs,
    settings,
)

__all__ = [
    "Calibrated", "Effect", "InputError", "Node", "Observer", "Port", "Setting", "SettingError", "Stream", "Switch",
    "Wants", "convert", "effects", "inputs", "outputs", "part", "settings",
]  # fmt: skip
