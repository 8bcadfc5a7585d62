"""Distributions of settings by name, for studies and ensembles: those of scipy.stats, and that of a published tissue.

{uniform: [130, 390]}, {norm: [19 kPa, 2 kPa]}, {published: liver-human}
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.engine.faults import Location, choices
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError, parse, split

PUBLISHED = "published"
DIGITS = 10
EDGE = 0.01  # [1] The quantiles EDGE and 1 - EDGE replace the bounds of an unbounded distribution
LEAST = 0.1  # [1] of the published mean: a modulus is not below it, however wide its spread is
EXPECTED = (
    "a list of values, {linspace: [low, high, number]}, geomspace, {named: {name: value}}, or a distribution: "
    "{uniform: [low, high]}, {norm: [mean, deviation]}, any other of scipy.stats, or {published: liver-human}"
)


def is_law(given: Any) -> bool:
    """Whether a value is a distribution: frozen by scipy.stats, or a mapping with only the name of one."""
    if hasattr(given, "ppf"):
        return True
    if not isinstance(given, Mapping) or len(given) != 1:
        return False
    (kind,) = given
    return kind == PUBLISHED or _of_scipy(str(kind)) is not None


def _of_scipy(kind: str) -> Any:
    import scipy.stats  # slow to import

    known = getattr(scipy.stats, kind, None)
    return known if isinstance(known, scipy.stats.rv_continuous) else None


def law_of(name: str, kind: str, how: Any) -> tuple[Any, tuple[str, ...]]:
    """A frozen distribution of scipy.stats by its name, and the texts of numbers with a unit; `uniform` takes its two
    bounds.

    name  path of the setting

    ArgumentError: it is invalid.
    """
    if kind == PUBLISHED:
        return _published(name, how), ()
    known = _of_scipy(kind)
    if known is None:
        raise ArgumentError(f"over {name}: found {short_text({kind: how})}, expected {EXPECTED}")
    if isinstance(how, Mapping):
        numbers, texts = numbers_of(name, list(how.values()), len(how))
        law = known(**dict(zip(how, numbers, strict=True)))
    else:
        numbers, texts = numbers_of(name, how, None)
        if kind == "uniform" and len(numbers) == 2:
            numbers[1] -= numbers[0]
        law = known(*numbers)
    if not np.isfinite(law.ppf([EDGE, 0.5, 1.0 - EDGE])).all():
        raise ArgumentError(f"over {name}: found {short_text({kind: how})}, which scipy.stats.{kind} cannot be")
    return law, texts


def _published(name: str, how: Any) -> Any:
    """The normal distribution of a setting that is proportional to the modulus of a published tissue, with the standard
    deviation of its record between subjects or specimens, cut at `LEAST` of the mean."""
    from scipy.stats import truncnorm

    from palpate.launch.load.tissues import deviation_of, settings, tissues

    records = tissues()[0].items()
    known = {tissue: record for tissue, record in records if deviation_of(record) and "scene" not in record}
    if how not in known:
        text = f"over {name}: found {short_text({PUBLISHED: how})}, expected a tissue with a published spread, as a "
        raise ArgumentError(text + "standard deviation. " + choices("Tissues", str(how), list(known)))
    record, setting = known[str(how)], name.rpartition(".")[2]
    usual = settings(str(how), Location(name)).get(setting)
    if setting not in ("young", "stiffness") or not isinstance(usual, float):
        raise ArgumentError(
            f"over {name}: found {short_text({PUBLISHED: how})}, which is a modulus; expected a path to `young` of "
            "ReducedFE or `stiffness` of MassSpring"
        )
    share = deviation_of(record)
    return truncnorm((LEAST - 1.0) / share, np.inf, loc=usual, scale=share * usual)


def numbers_of(name: str, given: Any, count: int | None) -> tuple[list[float], tuple[str, ...]]:
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
        raise ArgumentError(f"over {name}: found {short_text(given)}, expected {count or 'some'} numbers in a list")
    return numbers, tuple(texts)


def quantiles(design: str, count: int, samples: int, seed: int) -> np.ndarray:
    """Quantiles [1] (samples, count) of jointly sampled values, by "sobol", "lhs" or "random"."""
    if design == "random":
        return np.random.default_rng(seed).random((samples, count))
    from scipy.stats import qmc

    with warnings.catch_warnings():  # about numbers of samples that are not powers of 2
        warnings.simplefilter("ignore", UserWarning)
        kind = qmc.Sobol if design == "sobol" else qmc.LatinHypercube
        return np.asarray(kind(count, seed=seed).random(samples))


def values_at(law: Any, shares: np.ndarray) -> np.ndarray:
    """The values of a distribution at quantiles [1] (n); those at infinite bounds are at `EDGE` and 1 - `EDGE`."""
    values = law.ppf(shares)
    return round_values(np.where(np.isfinite(values), values, law.ppf(np.clip(shares, EDGE, 1.0 - EDGE))))


def round_values(values: np.ndarray) -> np.ndarray:
    """Round to `DIGITS` significant digits, so that other processors and versions of scipy give the same points."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])


def short_text(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 80 else f"{text[:76]} ..."
