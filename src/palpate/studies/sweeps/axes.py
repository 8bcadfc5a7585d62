"""Axes of a study: crossed lists of values, and samples of distributions.

{"tissue.stiffness": {"linspace": [200, 400, 5]},             # crossed with all others
 "finger.thickness, finger.finger_damping": [["3 mm", 6], ["4 mm", 8]],     # these two vary together
 "tissue.damping": {"uniform": [2, 8]}}                       # sampled jointly with all other distributions
"""

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.nodes.base import plain
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError, parse, split

GRIDS: dict[str, Any] = {"linspace": np.linspace, "geomspace": np.geomspace}
DESIGNS = ("sobol", "lhs", "random")
DIGITS = 10
MOST = 1_000_000  # Maximum number of values of one axis
EDGE = 0.01  # [1] The quantiles EDGE and 1 - EDGE replace the bounds of an unbounded distribution
EXPECTED = (
    "a list of values, {linspace: [low, high, number]}, geomspace, {named: {name: value}}, or a distribution: "
    "{uniform: [low, high]}, {norm: [mean, deviation]}, or any other of scipy.stats"
)


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
            raise ArgumentError(f"over {name}: found {_short(dict(given))}, expected {EXPECTED}")
        ((kind, how),) = given.items()
        if kind in GRIDS:
            (low, high, count), texts = _numbers(name, how, 3)
            if count > MOST:
                raise ArgumentError(f"over {name}: found {count:,.0f} values, expected up to {MOST:,}")
            if count != int(count) or count < 1 or (kind == "geomspace" and low * high <= 0):
                raise ArgumentError(f"over {name}: found {_short(how)}, expected [low, high, number of values]")
            given = round_values(GRIDS[kind](low, high, int(count)))
            return _listed_values(name, paths, given.tolist(), None, texts)
        if kind == "named" and isinstance(how, Mapping):
            return _listed_values(name, paths, list(how.values()), [str(key) for key in how], ())
        return _sample_values(paths, *_law(name, str(kind), how))
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if isinstance(given, str) or not isinstance(given, Sequence) or not given:
        raise ArgumentError(f"over {name}: found {_short(given)}, expected {EXPECTED}")
    return _listed_values(name, paths, list(given), None, ())


def _listed_values(name: str, paths: tuple[str, ...], given: list[Any], names: list[str] | None, texts: Any) -> Axis:
    rows = [(value,) for value in given] if len(paths) == 1 else given
    values = []
    for row in rows:
        if not isinstance(row, Sequence) or isinstance(row, str) or len(row) != len(paths):
            raise ArgumentError(f"over {name}: found {_short(row)}, expected {len(paths)} values in a list, one a path")
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


def _law(name: str, kind: str, how: Any) -> tuple[Any, tuple[str, ...]]:
    """A distribution of scipy.stats by name; `uniform` takes its two bounds. ArgumentError: it is invalid."""
    import scipy.stats

    known = getattr(scipy.stats, kind, None)
    if not isinstance(known, scipy.stats.rv_continuous):
        raise ArgumentError(f"over {name}: found {_short({kind: how})}, expected {EXPECTED}")
    if isinstance(how, Mapping):
        numbers, texts = _numbers(name, list(how.values()), len(how))
        law = known(**dict(zip(how, numbers, strict=True)))
    else:
        numbers, texts = _numbers(name, how, None)
        if kind == "uniform" and len(numbers) == 2:
            numbers[1] -= numbers[0]
        law = known(*numbers)
    if not np.isfinite(law.ppf([EDGE, 0.5, 1.0 - EDGE])).all():
        raise ArgumentError(f"over {name}: found {_short({kind: how})}, which scipy.stats.{kind} cannot be")
    return law, texts


def _numbers(name: str, given: Any, count: int | None) -> tuple[list[float], tuple[str, ...]]:
    """Numbers, with texts with a unit converted to SI, and these texts. ArgumentError: another kind of value."""
    numbers, texts = [], []
    try:
        for value in given if isinstance(given, Sequence) and not isinstance(given, str) else [None]:
            if isinstance(value, str):
                number, unit = split(value)
                texts.append(value)
                value = float(number * parse(unit).factor) if unit else float(number)
            numbers.append(float(value))  # type: ignore[arg-type]
    except (UnitError, TypeError, ValueError):
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)) or (count is not None and len(numbers) != count):
        raise ArgumentError(f"over {name}: found {_short(given)}, expected {count or 'some'} numbers in a list")
    return numbers, tuple(texts)


def round_values(values: np.ndarray) -> np.ndarray:
    """Round to `DIGITS` significant digits, so that other processors and versions of scipy give the same points."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


def label(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else json.dumps(value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 80 else f"{text[:76]} ..."


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
        columns = []
        for law, share in zip([one.law for one in self.sampled], self.cube.T, strict=True):
            values = law.ppf(share)
            columns.append(
                round_values(np.where(np.isfinite(values), values, law.ppf(np.clip(share, EDGE, 1.0 - EDGE))))
            )
        return np.column_stack(columns)

    @cached_property
    def cube(self) -> np.ndarray:
        """Quantiles [1] (samples, distributions) of the sampled values."""
        count, seed = len(self.sampled), self.seed
        if self.design.startswith("sensitivity"):
            from palpate.studies.sweeps.sensitivity import cube

            return cube(self.design.split()[1], count, self.samples, seed)
        if self.design == "random":
            return np.random.default_rng(seed).random((self.samples, count))
        from scipy.stats import qmc

        with warnings.catch_warnings():  # about numbers of samples that are not powers of 2
            warnings.simplefilter("ignore", UserWarning)
            kind = qmc.Sobol if self.design == "sobol" else qmc.LatinHypercube
            return kind(count, seed=seed).random(self.samples)

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
        at = np.unravel_index(number, self.shape) if self.shape else ()
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
