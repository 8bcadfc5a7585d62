"""Warming a node: what its step compiles, or loads from the cache of kernels, is there before the run begins."""

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from palpate.messages import Message, pack, unpack
from palpate.nodes.base import Port

STEP = 1e-3  # [s]


def warm(step: Callable[[list[Message | None], float], Any], ports: Sequence[Port]) -> None:
    """Step a started node on examples of its inputs: at rest, under a light load, and with optional inputs absent. Its
    state is that of no run afterwards: start it anew.

    step   of the node, which takes its messages and dt [s]
    ports  of these messages

    An example that a node refuses tells nothing of the run: it is passed over.
    """
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for tick, (loaded, absent) in enumerate(((False, False), (True, False), (True, True))):
            try:
                step([_example(port, tick, loaded, absent) for port in ports], STEP)
            except (Exception, SystemExit):
                continue


def _example(port: Port, tick: int, loaded: bool, absent: bool) -> Message | None:
    """As it comes from the wire: its arrays cannot be written, which to a compiler is a type of its own."""
    if absent and port.optional:
        return None
    made = msgspec.structs.replace(port.type.example(loaded), tick=tick, time=round(tick * STEP * 1e9))
    return unpack(pack(made), port.type)
