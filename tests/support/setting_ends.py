"""Values of numeric settings for searches: the ends of their ranges, and multiples of a value."""

import math
import typing

import msgspec

from palpate.nodes.base import Setting

FAR = 1e3  # [1] over the usual value, where a range has no end


def numeric(setting: Setting) -> bool:
    """Whether a setting is one number."""
    hint = setting.type
    while typing.get_origin(hint) is typing.Annotated or hasattr(hint, "__metadata__"):
        hint = typing.get_args(hint)[0]
    return hint in (float, int)


def whole(setting: Setting) -> bool:
    hint = setting.type
    while hasattr(hint, "__metadata__"):
        hint = typing.get_args(hint)[0]
    return hint is int


def ends(setting: Setting, usual: float) -> tuple[float, float]:
    """The least and the greatest value of a setting; where its range has no end, or its end is excluded, a value
    `FAR` below or above the usual one."""
    limits = [mark for mark in getattr(setting.type, "__metadata__", ()) if isinstance(mark, msgspec.Meta)]
    limit = limits[0] if limits else msgspec.Meta()
    size = abs(usual) or 1e-3
    low = limit.ge if limit.ge is not None else size / FAR
    high = limit.le if limit.le is not None else size * FAR
    if limit.lt is not None:
        high = limit.lt * (1.0 - 1e-3)
    return (math.floor(low), max(1, math.ceil(high))) if whole(setting) else (float(low), float(high))
