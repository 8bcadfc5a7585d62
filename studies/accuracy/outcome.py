"""A method, its settings, and what it makes of a touch."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.studies.accuracy.touches import BenchCase

NEAR = 16e-3  # [m] From the foot point within which the shape of the surface is compared
LOOKS = 12  # Instants of a touch at which it is


@dataclass(frozen=True)
class Fidelity:
    """One setting of a method.

    rate      [Hz] of the steps
    settings  by node: {"body": {...}, "spread": {...}, "surface": {...}}
    quick     whether a quick run has it
    """

    name: str
    rate: float = 1000.0
    settings: dict[str, dict[str, object]] = field(default_factory=dict)
    quick: bool = False


@dataclass
class MethodOutcome:
    """Of one method at one fidelity.

    times    [s] (T,)
    values   by name of `truth.QUANTITIES`, each (T,); what the method does not tell is not there
    shapes   (time [s], points [m] (k,2), depth [m] (k,)) at some instants
    steps    [s] (n,) time that each step took
    memory   [byte] arrays that the method holds, None where nobody counted; offline [s] once, before
    """

    times: np.ndarray
    values: dict[str, np.ndarray]
    shapes: list[tuple[float, np.ndarray, np.ndarray]]
    steps: np.ndarray
    memory: int | None
    offline: float


@dataclass(frozen=True)
class Method:
    """One method.

    compute     (touch, fidelity, repeats) -> outcome; raises UnsupportedError, or what went wrong
    refuses     why it cannot compute a touch; empty where it can
    fidelities  what it is tried at
    """

    name: str
    title: str
    compute: Callable[[BenchCase, Fidelity, int], MethodOutcome]
    fidelities: tuple[Fidelity, ...]
    refuses: Callable[[BenchCase], str] = lambda touch: ""
    law: bool = False
    """Whether it is a law of contact alone, without a body: it can do one or two test cases."""
    source: tuple[str, ...] = field(default_factory=tuple)
    """What else its answers depend on, for the key of a kept result."""
