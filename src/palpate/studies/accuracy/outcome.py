"""A method of the benchmark, its settings and its results on a test case."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.studies.accuracy.cases import BenchCase

NEAR = 16e-3  # [m] Radius around the foot point within which the shape of the surface is compared
LOOKS = 12  # Number of instants of a touch at which the shape is compared


@dataclass(frozen=True)
class Fidelity:
    """One setting of a method.

    rate      [Hz] of the steps
    settings  by node: {"body": {...}, "spread": {...}, "surface": {...}}
    quick     whether a quick run includes it
    """

    name: str
    rate: float = 1000.0
    settings: dict[str, dict[str, object]] = field(default_factory=dict)
    quick: bool = False


@dataclass
class MethodOutcome:
    """Results of one method at one fidelity.

    times    [s] (T,)
    values   by name of `reference.QUANTITIES`, each (T,); only those that the method computes
    shapes   (time [s], points [m] (k,2), depth [m] (k,)) at `LOOKS` instants
    steps    [s] (n,) time of each step
    memory   [byte] size of all arrays of the method, None: not counted;  offline [s] time before the first step
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

    compute     (touch, fidelity, repeats) -> outcome; UnsupportedError: the test case is not supported
    refuses     reason why a test case is not supported, or ""
    fidelities  its settings in the benchmark
    law         whether it is a contact law without a body, which supports one or two test cases
    source      further dependencies of its results, for the key of a cached result
    """

    name: str
    title: str
    compute: Callable[[BenchCase, Fidelity, int], MethodOutcome]
    fidelities: tuple[Fidelity, ...]
    refuses: Callable[[BenchCase], str] = lambda touch: ""
    law: bool = False
    source: tuple[str, ...] = ()
