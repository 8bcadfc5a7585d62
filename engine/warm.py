"""Warming a node: what its step compiles, or loads from the cache of kernels, is there before the run begins."""

from __future__ import annotations

import inspect
import warnings
from typing import Any

import msgspec
import numpy as np

from palpate.messages import pack, unpack
from palpate.nodes.base import Node, Port, inputs

STEP = 1e-3  # [s]


def warm(node: Node, counts: tuple[int, ...]) -> None:
    """Step a started node on examples of its inputs: at rest, under a light load, and with optional inputs absent. Its
    state is that of no run afterwards: start it anew.

    counts  how many messages each port gets, see `slot.counts`

    An example that a node refuses tells nothing of the run: it is passed over.
    """
    ports = list(zip(inputs(type(node)), counts, strict=True))
    given = {"dt": STEP} if "dt" in inspect.signature(type(node).step).parameters else {}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for tick, (loaded, absent) in enumerate(((False, False), (True, False), (True, True))):
            try:
                node.step(*(_argument(port, count, tick, loaded, absent) for port, count in ports), **given)
            except (Exception, SystemExit):
                continue


def _argument(port: Port, count: int, tick: int, loaded: bool, absent: bool) -> Any:
    """As it comes from the wire: its arrays cannot be written, which to a compiler is a type of its own."""
    message = None
    if not (absent and port.optional):
        made = msgspec.structs.replace(port.type.example(loaded), tick=tick, time=round(tick * STEP * 1e9))
        message = unpack(pack(made), port.type)
    return message if count < 0 else [message] * count
