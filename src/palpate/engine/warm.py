"""Warm-up of a node: its kernels are compiled, or loaded from the cache, before the run begins."""

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np

from palpate.messages import Message, pack, unpack
from palpate.nodes.base import Port

STEP = 1e-3  # [s]


def warm(step: Callable[[list[Message | None], float], Any], ports: Sequence[Port]) -> None:
    """Step a started node on examples of its inputs: at rest, under a light load, and without optional inputs. This
    leaves an arbitrary state: start the node again afterwards. Exceptions are ignored, because an example need not
    fit the node.

    step   the node's step: messages, dt [s]
    ports  the ports of these messages
    """
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for tick, (loaded, absent) in enumerate(((False, False), (True, False), (True, True))):
            try:
                step([_example(port, tick, loaded, absent) for port in ports], STEP)
            except (Exception, SystemExit):
                continue


def _example(port: Port, tick: int, loaded: bool, absent: bool) -> Message | None:
    """An example as received from the wire: its arrays are read-only, which is a separate type for the compiler."""
    if absent and port.optional:
        return None
    made = msgspec.structs.replace(port.type.example(loaded), tick=tick, time=round(tick * STEP * 1e9))
    return unpack(pack(made), port.type)
