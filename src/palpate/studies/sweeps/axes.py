"""Axes of a study: crossed lists of values, and samples of distributions.

{"tissue.stiffness": {"linspace": [200, 400, 5]},             # crossed with all others
 "finger.thickness, finger.finger_damping": [["3 mm", 6], ["4 mm", 8]],     # these two vary together
 "tissue.damping": {"uniform": [2, 8]}}                       # sampled jointly with all other distributions
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.launch.load.values.distributions import (
    EXPECTED,
    law_of,
    numbers_of,
    quantiles,
    round_values,
    short_text,
    values_at,
)
from palpate.nodes.base import plain
from palpate.physics.errors import ArgumentError

GRIDS: dict[str, Any] = {"linspace": np.linspace, "geomspace": np.geomspace}
DESIGNS = ("sobol", "lhs", "random")
MOST = 1_000_000  # Maximum number of values of one axis


@dataclass(frozen=True)
class Axis:
    """One entry of `over`.

    paths   paths in the form of `--set` that vary together
    values  per value of the axis, the value of each path; () for a distribution
    labels  the same for tables: numbers, booleans and texts
    law     frozen distribution of scipy.stats of a single path; None: the values are listed
    texts   original texts of numbers that were given with a unit
    """

    paths: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...] = ()
    labels: tuple[tuple[Any, ...], ...] = ()
    law: Any = None
    texts: tuple[str, ...] = ()


def axis(name: str, given: Any) -> Axis:
    """An entry of `over`: a path, or comma-separated paths that vary together, and their values. ArgumentError: it is
    invalid."""
    paths = tuple(part.strip() for part in str(name).split(","))
    if not all(paths):
        raise ArgumentError(f"over {name!r}: found an empty path, expected one such as tissue.stiffness")
    if hasattr(given, "ppf"):
        return _sample_values(paths, given, ())
    if isinstance(given, Mapping):
        if len(given) != 1:
            raise ArgumentError(f"over {name}: found {short_text(dict(given))}, expected {EXPECTED}")
        ((kind, how),) = given.items()
        if kind in GRIDS:
            (low, high, count), texts = numbers_of(name, how, 3)
            if count > MOST:
                raise ArgumentError(f"over {name}: found {count:,.0f} values, expected up to {MOST:,}")
            if count != int(count) or count < 1 or (kind == "geomspace" and low * high <= 0):
                raise ArgumentError(f"over {name}: found {short_text(how)}, expected [low, high, number of values]")
            given = round_values(GRIDS[kind](low, high, int(count)))
            return _listed_values(name, paths, given.tolist(), None, texts)
        if kind == "named" and isinstance(how, Mapping):
            return _listed_values(name, paths, list(how.values()), [str(key) for key in how], ())
        return _sample_values(paths, *law_of(name, str(kind), how))
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        raise ArgumentError(f"over {name}: found {short_text(given)}, expected {EXPECTED}")
    return _listed_values(name, paths, list(given), None, ())


def _listed_values(name: str, paths: tuple[str, ...], given: list[Any], names: list[str] | None, texts: Any) -> Axis:
    rows = [(value,) for value in given] if len(paths) == 1 else given
    values = []
    for row in rows:
        if not isinstance(row, Sequence) or isinstance(row, str) or len(row) != len(paths):
            raise ArgumentError(
                f"over {name}: found {short_text(row)}, expected {len(paths)} values in a list, one a path"
            )
        values.append(tuple(plain(value) for value in row))
    labels = [tuple(map(label, row)) for row in values] if names is None else [(n,) * len(paths) for n in names]
    if len(set(map(repr, labels))) < len(labels):
        twice = next(one for one in labels if labels.count(one) > 1)
        raise ArgumentError(f"over {name}: {', '.join(map(str, twice))} stands twice, expected each value once")
    return Axis(paths, tuple(values), tuple(labels), None, texts)


def _sample_values(paths: tuple[str, ...], law: Any, texts: tuple[str, ...]) -> Axis:
    if len(paths) > 1:
        raise ArgumentError(
            f"over {', '.join(paths)}: found a distribution, expected values of paths that vary together"
        )
    return Axis(paths, law=law, texts=texts)


def label(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


@dataclass(frozen=True)
class Space:
    """All points of a study, in order; the last axis varies fastest.

    axes     the axes
    samples  number of joint samples of all distributions
    design   one of `DESIGNS`, or "sensitivity sobol", "sensitivity morris" (see `sensitivity`)
    seed     seed of the samples
    """

    axes: tuple[Axis, ...]
    samples: int = 0
    design: str = "sobol"
    seed: int = 0

    @cached_property
    def crossed(self) -> tuple[Axis, ...]:
        return tuple(one for one in self.axes if one.law is None)

    @cached_property
    def sampled(self) -> tuple[Axis, ...]:
        return tuple(one for one in self.axes if one.law is not None)

    @property
    def paths(self) -> list[str]:
        """All paths, the sampled ones last."""
        return [path for one in (*self.crossed, *self.sampled) for path in one.paths]

    @cached_property
    def drawn(self) -> np.ndarray:
        """Values (samples, distributions) of the sampled paths."""
        laws = [one.law for one in self.sampled]
        return np.column_stack([values_at(law, shares) for law, shares in zip(laws, self.cube.T, strict=True)])

    @cached_property
    def cube(self) -> np.ndarray:
        """Quantiles [1] (samples, distributions) of the sampled values."""
        count, seed = len(self.sampled), self.seed
        if self.design.startswith("sensitivity"):
            from palpate.studies.sweeps.sensitivity import cube

            return cube(self.design.split()[1], count, self.samples, seed)
        return quantiles(self.design, count, self.samples, seed)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Numbers of values of the crossed axes, then the number of samples if the study has distributions."""
        return (*(len(one.values) for one in self.crossed), *((len(self.drawn),) if self.sampled else ()))

    def __len__(self) -> int:
        return math.prod(self.shape)

    def columns(self, of: str = "values") -> dict[str, list[Any]]:
        """All values of each path, or with "labels" those for tables."""
        listed = {p: [row[k] for row in getattr(one, of)] for one in self.crossed for k, p in enumerate(one.paths)}
        return listed | {one.paths[0]: self.drawn[:, k].tolist() for k, one in enumerate(self.sampled)}

    def point(self, number: int) -> tuple[dict[str, Any], dict[str, Any]]:
        """The value of each path at a point, and its label in tables."""
        at: tuple[Any, ...] = np.unravel_index(number, self.shape) if self.shape else ()
        values: dict[str, Any] = {}
        labels: dict[str, Any] = {}
        for one, index in zip(self.crossed, at, strict=False):
            values |= zip(one.paths, one.values[index], strict=True)
            labels |= zip(one.paths, one.labels[index], strict=True)
        if self.sampled:
            row = dict(zip((one.paths[0] for one in self.sampled), self.drawn[at[-1]].tolist(), strict=True))
            values |= row
            labels |= row
        return values, labels
