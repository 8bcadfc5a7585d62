"""A cache for results that are computed from a mesh or a surface."""

import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, TypeVar

import numpy as np

Result = TypeVar("Result")
KEPT = 4  # Number of cached results per function


def keep_results(function: Callable[..., Result]) -> Callable[..., Result]:
    """Decorator: cache the last `KEPT` results by the content of the arguments (arrays, numbers, and tuples and
    dataclasses of these). The results are shared: do not write to them."""
    results: dict[tuple, Result] = {}

    @wraps(function)
    def of(*given: Any) -> Result:
        key = tuple(_content(one) for one in given)
        if key not in results:
            if len(results) == KEPT:
                del results[next(iter(results))]
            results[key] = function(*given)
        return results[key]

    return of


def _content(given: Any) -> Any:
    if isinstance(given, np.ndarray):
        return given.shape, given.dtype.str, hashlib.sha256(np.ascontiguousarray(given).data).digest()
    if isinstance(given, tuple):
        return tuple(map(_content, given))
    if is_dataclass(given):
        return tuple(_content(getattr(given, field.name)) for field in fields(given))
    return given
